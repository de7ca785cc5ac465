"""`imgtransfer predict`: maps and vertices of the garment for clips of a body in motion."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING, Any

from imgtransfer.cli.options import add_clip_choice, add_runner, chosen_executor, chosen_refs
from imgtransfer.pipeline.folder import MAPS_FILE, POSITION_ONLY_FILE, check_replaceable, folder_of_clip
from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.data.clip import Clip
    from imgtransfer.running import Executor


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "predict",
        help="predict maps and vertices for clips, by the networks or another method",
        description=f"Writes OUT/CLIP/{MAPS_FILE}, for `imgtransfer fuse`, and OUT/CLIP/{POSITION_ONLY_FILE}, the "
        "vertices read from the position maps alone. The clips need no garment vertices. Clips that this model "
        "has predicted already are left as they are, so a stopped run goes on. Of a method that makes no maps, "
        f"{POSITION_ONLY_FILE} has its vertices, and there are maps of them with --fuse.",
        examples=(
            "imgtransfer predict configs/pretrained configs/sample_data/tshirt.zarr.zip --split test --out predictions",
            "imgtransfer predict runs/demo my_data.zarr --clip 'tshirt/walk*' --workers 2 --out walks",
        ),
    )
    parser.add_argument(
        "model",
        type=Path,
        help="a run's folder or a model.safetensors, of whatever method, or OWNER/NAME on the Hugging Face hub",
    )
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
    parser.add_argument(
        "--settle",
        action="store_true",
        help="let the templates hang on their resting bodies first, by simulation (extra simulate), for a model of "
        "many garments, which expects that; a pattern, or what was only put on, lies centimetres higher than it ever "
        "does",
    )
    parser.add_argument(
        "--pinned",
        action="store_true",
        help="with --settle: the garments' topmost opening is a waistband, which stays on the skin",
    )
    parser.add_argument(
        "--anyway",
        action="store_true",
        help="with --settle: take a template although it slips off or is stretched while it is let hang, such as a "
        "hood that is meant to fall back",
    )
    parser.add_argument(
        "--fuse",
        action="store_true",
        help="then refine each clip as `imgtransfer fuse` does, with its default settings; both results stay",
    )
    add_runner(parser)
    return parser


def run(args: argparse.Namespace) -> None:
    """Predict every chosen clip, and say where the results are; a clip's folder appears whole or not at all."""
    from imgtransfer.deformers.checkpoint import is_deformer  # noqa: PLC0415
    from imgtransfer.running import run_tasks  # noqa: PLC0415
    from imgtransfer.training.hub import model_path  # noqa: PLC0415

    for option in ("pinned", "anyway"):
        if getattr(args, option) and not args.settle:
            raise InputError(
                f"--{option} says how a garment is let hang; give --settle with it, or leave it out"
            )
    executor = chosen_executor(args)
    args.model = model_path(args.model)
    chosen = _of_method(args) if is_deformer(args.model) else _of_network(args)
    run = run_tasks(chosen.function, chosen.tasks, executor=executor, name=lambda task: task.name)
    if args.fuse:
        _fuse([task.folder for task in chosen.tasks if task.name in run.values], executor)
    replace(run, failures=chosen.damaged | run.failures).check()
    choice = ["--split", args.split] if args.split else []
    choice += [word for name in args.clip or () for word in ("--clip", name)]
    words = ["imgtransfer", "evaluate", str(args.out), "--truth", str(args.source), *choice]
    lines = [] if args.fuse or chosen.without_maps else [join(["imgtransfer", "fuse", str(args.out)])]
    lines += [join(words)] if chosen.with_garment else []
    for heading, line in zip(("next", "then"), lines, strict=False):
        print(f"{heading:<8} {line}")


@dataclass(frozen=True)
class _Chosen:
    """What is to be predicted.

    Attributes:
        function: that predicts one clip; tasks: for it.
        damaged: by name, why a clip cannot be read.
        with_garment: whether all clips have the truth.
        without_maps: whether the model makes none.
    """

    function: Callable[[Any], str]
    tasks: list[Any]
    damaged: dict[str, str]
    with_garment: bool
    without_maps: bool = False


def _of_network(args: argparse.Namespace) -> _Chosen:
    from imgtransfer.network.shapes import check_hangs  # noqa: PLC0415
    from imgtransfer.pipeline.predict import PredictTask, predict_clip  # noqa: PLC0415
    from imgtransfer.training.checkpoint import fingerprint, load_model  # noqa: PLC0415
    from render.extras import check_installed  # noqa: PLC0415

    model, mark = load_model(args.model), fingerprint(args.model)
    if args.no_mirrored_average and not model.mirrored_average:
        raise InputError(
            f"{args.model}: does not average with mirrored predictions, as models trained with training.mirror do; "
            "leave out --no-mirrored-average"
        )
    if args.settle:
        check_hangs(model.general, model.source)
        check_installed("simulate", "--settle", "newton")
    clips = _checked(args, model.check_garment)
    path = _everywhere(args.model, args)
    chosen = {
        "overwrite": args.overwrite,
        "mirrored_average": not args.no_mirrored_average,
        "settle": args.settle,
        "pinned": args.pinned,
        "anyway": args.anyway,
    }
    tasks = [PredictTask(path, mark, ref, folder, **chosen) for ref, folder in clips.tasks]
    return replace(clips, function=predict_clip, tasks=tasks)


def _of_method(args: argparse.Namespace) -> _Chosen:
    from imgtransfer.deformers.checkpoint import load_deformer  # noqa: PLC0415
    from imgtransfer.deformers.predict import DeformTask, deform_clip  # noqa: PLC0415
    from imgtransfer.training.checkpoint import fingerprint  # noqa: PLC0415

    if args.no_mirrored_average:
        raise InputError(
            f"--no-mirrored-average: {args.model} is of a method that averages nothing; leave it out"
        )
    if args.settle:
        raise InputError(
            f"--settle: {args.model} is of a method that is fitted to its own template; leave it out"
        )
    deformer, mark = load_deformer(args.model), fingerprint(args.model)
    clips = _checked(args, deformer.check)
    path = _everywhere(args.model, args)
    tasks = [DeformTask(path, mark, ref, folder, args.fuse, args.overwrite) for ref, folder in clips.tasks]
    return replace(clips, function=deform_clip, tasks=tasks, without_maps=True)


def _checked(args: argparse.Namespace, check: Callable[[Clip], object]) -> _Chosen:
    """The clips and their folders, all looked at before any work: a wrong one would stop the command half-way."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.data.location import everywhere  # noqa: PLC0415

    chosen, damaged, with_garment = [], {}, True
    refs = chosen_refs(args, args.source)
    for ref in tqdm(refs, desc="checking", unit="clip", leave=False, delay=2, disable=None):
        try:
            still = ref.still()
        except InputError as error:
            damaged[ref.name] = str(error)  # the others are predicted
            continue
        check(still)
        with_garment &= still.garment is not None
        check_replaceable(args.out / folder_of_clip(ref.name))
        folder = _everywhere(args.out, args) / folder_of_clip(ref.name)
        chosen.append((replace(ref, source=everywhere(ref.source)), folder))
    return _Chosen(str, chosen, damaged, with_garment)


def _everywhere(path: Path, args: argparse.Namespace) -> Path:
    """A path as other machines have it: their processes have another working folder."""
    return path.resolve() if args.ray else path


def _fuse(folders: Sequence[Path], executor: Executor) -> None:
    from fusion.config import FusionConfig  # noqa: PLC0415
    from imgtransfer.pipeline.fuse import FuseOptions  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_summary import FusedClip, summary  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_task import FuseTask, frames_to_fuse, fuse_clip  # noqa: PLC0415
    from imgtransfer.running import run_tasks  # noqa: PLC0415

    done = run_tasks(
        fuse_clip,
        [FuseTask(folder=folder, options=FuseOptions(config=FusionConfig())) for folder in folders],
        executor=executor,
        name=lambda task: task.name,
        say=FusedClip.line,
        unit="frame",
        size=frames_to_fuse,
    )
    if done.values:
        print(summary(done.values.values()))
    done.check()
