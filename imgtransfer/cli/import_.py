"""`imgtransfer import`: clip npz files into a data set."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from render import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "import",
        help="add clip npz files to a data set",
        description="The data set is made where there is none. tshirt_walk.npz becomes tshirt/walk.",
    )
    parser.add_argument("clip", nargs="+", type=Path, help="clip npz file, or a folder of them")
    parser.add_argument("--to", required=True, type=Path, metavar="DATASET", help="the data set's folder")
    parser.add_argument("--split", required=True, help="such as train or test")
    parser.add_argument("--garment", help="name of the garment; default the file's name up to its first '_'")
    parser.add_argument("--title", default="", help="of a new data set")
    parser.add_argument("--licence", default="", help="of a new data set, such as CC-BY-4.0")
    parser.add_argument("--source", default="", help="of a new data set: where the clips come from")
    return parser


def run(args: argparse.Namespace) -> None:
    """Read every clip, so that a bad one stops the import before anything is written; then write them."""
    from imgtransfer.data.source import open_clips  # noqa: PLC0415
    from imgtransfer.data.store import DataSet, check_name  # noqa: PLC0415

    clips = [clip for path in args.clip for clip in open_clips(path)]
    names = [_name(clip.name, args.garment) for clip in clips]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"several files would become clip {', '.join(twice)}; rename them or import them apart"
        )
    for name in names:
        check_name(name, args.split)
    data = DataSet.open_or_create(args.to, title=args.title, licence=args.licence, source=args.source)
    for name, clip in zip(names, clips, strict=True):
        data.write(name, clip, split=args.split)
        print(f"{name}  {clip.n_frames} frames  {args.split}")


def _name(name: str, garment: str | None) -> str:
    """The clip's name in the data set, "<garment>/<clip>"."""
    stem = re.sub(r"[^\w./-]+", "-", name)
    if garment is not None:
        own, motion = garment, stem.rpartition("/")[2]
    else:
        own, _, motion = (
            stem.replace("__", "/").partition("/") if "__" in stem or "/" in stem else stem.partition("_")
        )
    return f"{own}/{motion or own}"
