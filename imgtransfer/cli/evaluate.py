"""`imgtransfer evaluate`: how far predictions are from the truth."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_changes, add_clip_choice, chosen_refs
from imgtransfer.pipeline.folder import METHODS, clip_of_folder, folders_in
from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    import numpy as np

    from imgtransfer.data.clip import Clip
    from imgtransfer.data.source import ClipRef

    Pairs = Iterator[tuple[Clip, np.ndarray]]


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "evaluate",
        help="compare predictions with the truth",
        description="Distances, perceptual difference and body penetration, per clip and overall.",
        examples=(
            "imgtransfer evaluate predictions --truth configs/sample_data/tshirt.zarr.zip",
            "imgtransfer evaluate --baseline lbs --truth configs/sample_data/tshirt.zarr.zip --split test",
        ),
    )
    parser.add_argument(
        "prediction",
        nargs="*",
        type=Path,
        help="clip npz with predicted garment vertices, or a folder that predict or fuse wrote",
    )
    parser.add_argument("--truth", required=True, type=Path, help="data set, clip npz or folder of clip npz")
    parser.add_argument(
        "--method", choices=METHODS, help="which file of a prediction folder; default the best"
    )
    parser.add_argument("--baseline", choices=("lbs",), help="measure skinning instead of a prediction")
    add_clip_choice(parser)
    parser.add_argument("--config", type=Path, help="YAML with parameters of the metrics that differ")
    add_changes(parser, "sted.frame_step=0.01")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser


def run(args: argparse.Namespace) -> None:
    """Measure and print."""
    from imgtransfer.config.loader import load_config  # noqa: PLC0415
    from imgtransfer.evaluation.config import EvaluateConfig  # noqa: PLC0415
    from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames  # noqa: PLC0415
    from imgtransfer.evaluation.table import metrics_json, metrics_table  # noqa: PLC0415

    if bool(args.prediction) == bool(args.baseline):
        raise InputError("evaluate: give either predictions or --baseline lbs")
    config = load_config(EvaluateConfig, args.config, args.set)
    refs = {ref.name: ref for ref in chosen_refs(args, args.truth)}
    measured, lengths = {}, {}
    for truth, predicted in _baseline(args, refs) if args.baseline else _predictions(args, refs):
        name = truth.name
        if truth.garment is None:
            raise InputError(f"{args.truth}: clip {name} has no garment vertices to compare with")
        lengths[name] = truth.n_frames
        try:
            measured[name] = evaluate_clip(
                predicted,
                truth.garment.vertices,
                truth.template.faces,
                truth.body.vertices,
                truth.body.faces,
                config=config,
            )
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    overall = mean_over_frames((values, lengths[name]) for name, values in measured.items())
    table = metrics_table({**measured, "overall": overall})
    print(metrics_json(measured, overall, config) if args.json else table)
    if any(path.is_dir() and not _of_one_clip(path) for path in args.prediction):
        _say_missing(refs, measured)


def _say_missing(refs: Mapping[str, ClipRef], measured: Collection[str]) -> None:
    """Say on stderr which clips of the splits that were predicted have no prediction; without splits, of all."""
    from imgtransfer.data.choice import some  # noqa: PLC0415

    splits = {refs[name].split for name in measured}
    wanted = [name for name, ref in refs.items() if ref.split in splits]
    if missing := [name for name in wanted if name not in measured]:
        of = "" if None in splits else f" of the split {' and '.join(sorted(map(str, splits)))}"
        print(
            f"no prediction for {len(missing)} of {len(wanted)} clips{of}, left out: {some(missing, 4)}",
            file=sys.stderr,
        )


def _baseline(args: argparse.Namespace, refs: Mapping[str, ClipRef]) -> Pairs:
    from imgtransfer.evaluation.skinning import lbs_baseline  # noqa: PLC0415

    if args.method is not None:
        raise InputError(f"--method {args.method}: says which predictions to read, and --baseline reads none")
    clips = (ref.load() for ref in refs.values())
    return ((clip, lbs_baseline(clip)) for clip in clips)


def _predictions(args: argparse.Namespace, refs: Mapping[str, ClipRef]) -> Pairs:
    """Pairs of the true clip and predicted vertices (T, N, 3); one in memory at a time."""
    from imgtransfer.data.choice import some  # noqa: PLC0415
    from imgtransfer.pipeline.predictions import predicted_vertices  # noqa: PLC0415

    files = _prediction_files(args.prediction, args.method)
    if len(files) == len(refs) == 1:  # two files: they are meant for each other, whatever their names
        files = dict(zip(refs, files.values(), strict=True))
    unknown = [name for name in files if name not in refs]
    if len(unknown) == len(files) or (unknown and not (args.split or args.clip)):
        raise InputError(
            f"{args.truth}: no truth for the prediction of {some(unknown)}; there are {some(list(refs))}"
        )
    chosen = {name: file for name, file in files.items() if name in refs}
    if {file.stem for file in chosen.values()} == set(METHODS):  # a mean over both, which nobody may want
        lacking = [name for name, file in chosen.items() if file.stem == METHODS[1]]
        print(f"{METHODS[1]} measured of {', '.join(lacking)}, which are not fused", file=sys.stderr)
    return ((refs[name].load(), predicted_vertices(file)) for name, file in chosen.items())


def _of_one_clip(folder: Path) -> bool:
    """Whether a folder is one clip's in what `imgtransfer predict` wrote."""
    return any((folder / f"{method}.npz").is_file() for method in METHODS)


def _prediction_files(paths: Sequence[Path], method: str | None) -> dict[str, Path]:
    """The file of each predicted clip, by the clip's name."""
    names = [f"{stem}.npz" for stem in ([method] if method else METHODS)]
    files: dict[str, Path] = {}
    for path in paths:
        if path.is_file():
            if method is not None:
                raise InputError(
                    f"--method {method}: chooses a file of a prediction's folder; {path} is a file"
                )
            stem = path.parent.name if path.stem in METHODS else path.stem
            files[clip_of_folder(stem)] = path
            continue
        if not path.is_dir():
            raise InputError(f"{path}: no such file or folder; a prediction is wanted")
        results = {
            clip_of_folder(folder.resolve().name): folder / name
            for folder in folders_in(path)
            for name in reversed(names)  # the better one last, so that it stays
            if (folder / name).is_file()
        }
        if not results and not method:
            results = {clip_of_folder(file.stem): file for file in sorted(path.glob("*.npz"))}
        if not results:
            raise InputError(f"{path}: no prediction in it; wanted are folders with {' or '.join(names)}")
        files |= results
    return files
