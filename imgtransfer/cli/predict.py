"""`imgtransfer predict`: maps and vertices of the garment for clips of a body in motion."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from shlex import join

from imgtransfer.cli.options import add_clip_choice, add_runner, chosen_executor, chosen_refs
from imgtransfer.pipeline.folder import MAPS_FILE, POSITION_ONLY_FILE, check_replaceable, folder_of_clip
from render import InputError


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "predict",
        help="predict maps and vertices for clips",
        description=f"Writes OUT/CLIP/{MAPS_FILE}, for `imgtransfer fuse`, and OUT/CLIP/{POSITION_ONLY_FILE}, the "
        "vertices read from the position maps alone. The clips need no garment vertices. Clips that this model "
        "has predicted already are left as they are, so a stopped run goes on.",
        examples=(
            "imgtransfer predict configs/pretrained configs/sample_data/tshirt.zarr.zip --split test --out predictions",
            "imgtransfer predict runs/demo my_data.zarr --clip 'tshirt/walk*' --workers 2 --out walks",
        ),
    )
    parser.add_argument("model", type=Path, help="a run's folder or a model.safetensors")
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    add_clip_choice(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results, one folder a clip")
    parser.add_argument(
        "--overwrite", action="store_true", help="predict clips again that are predicted already"
    )
    parser.add_argument(
        "--no-mirrored-average",
        action="store_true",
        help="predict each frame once, not also its mirror image to average both, as is done for models trained with "
        "training.mirror; takes half of the networks' time",
    )
    add_runner(parser)
    return parser


def run(args: argparse.Namespace) -> None:
    """Predict every chosen clip, and say where the results are; a clip's folder appears whole or not at all."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.data.location import everywhere  # noqa: PLC0415
    from imgtransfer.pipeline.predict import PredictTask, predict_clip  # noqa: PLC0415
    from imgtransfer.running import run_tasks  # noqa: PLC0415
    from imgtransfer.training.checkpoint import fingerprint, load_model  # noqa: PLC0415

    executor = chosen_executor(args)
    model, mark = load_model(args.model), fingerprint(args.model)
    if args.no_mirrored_average and not model.mirrored_average:
        raise InputError(
            f"{args.model}: does not average with mirrored predictions, as models trained with training.mirror do; "
            "leave out --no-mirrored-average"
        )
    # Another machine's processes have another working folder.
    path, out = (args.model.resolve(), args.out.resolve()) if args.ray else (args.model, args.out)
    tasks, damaged, with_garment = [], {}, True
    refs = chosen_refs(args, args.source)
    for ref in tqdm(refs, desc="checking", unit="clip", leave=False, delay=2, disable=None):
        try:
            still = ref.still()
        except InputError as error:
            damaged[ref.name] = str(error)  # the others are predicted
            continue
        model.check_garment(still)  # all before any work: a wrong one would stop the command half-way
        with_garment &= still.garment is not None
        check_replaceable(args.out / folder_of_clip(ref.name))
        clip = replace(ref, source=everywhere(ref.source))
        folder = out / folder_of_clip(ref.name)
        tasks.append(PredictTask(path, mark, clip, folder, args.overwrite, not args.no_mirrored_average))
    run = run_tasks(predict_clip, tasks, executor=executor, name=lambda task: task.name)
    replace(run, failures=damaged | run.failures).check()
    choice = ["--split", args.split] if args.split else []
    choice += [word for name in args.clip or () for word in ("--clip", name)]
    print(f"next     {join(['imgtransfer', 'fuse', str(args.out)])}")
    if with_garment:
        words = ["imgtransfer", "evaluate", str(args.out), "--truth", str(args.source), *choice]
        print(f"then     {join(words)}")
