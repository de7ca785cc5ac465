"""`imgtransfer export`: a clip out of a data set, for other programs."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, at_least_one, chosen_refs
from render import InputError

if TYPE_CHECKING:
    from imgtransfer.data.source import ClipRef

_TOGETHER = 32  # frames that are read together


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "export",
        help="write a clip as GLB, USD, Alembic, point caches, OBJ or PLY files or npz, or a data set as one zip file",
        description="Vertex order never changes: a garment imported with --weld comes out as its own file had it, with "
        "its texture coordinates and materials. The ending of --out chooses the form: .glb; .usd, .usdc, .usda, .usdz "
        "(extra `usd`); .abc (extra `alembic`); .pc2 and .mdd, each with the mesh that it moves as OBJ beside it, and "
        "the body's as NAME_body; .npz. A folder gets garment and body "
        "in every frame and in the rest pose, as `import meshes` reads them; a .zip gets every clip that is chosen, as "
        "a data set in one file, which all commands read where it lies. Every frame is written if --step does not say "
        "otherwise; the first is frame 0. Metres, y up.",
        examples=(
            "imgtransfer export configs/sample_data/tshirt.zarr.zip --clip tshirt/walk_s104 --out walk.usd",
            "imgtransfer export my_data.zarr --out my_data.zarr.zip",
        ),
    )
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    add_clip_choice(parser)
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        help="FILE.glb, FILE.usd and so on, DATA.zarr.zip, or a folder for one file a frame",
    )
    parser.add_argument(
        "--frames-as",
        choices=("obj", "ply"),
        help="form of the files in a folder; default obj",
    )
    parser.add_argument(
        "--step",
        type=at_least_one,
        help="take every so many frames, for smaller files; default 1, all of them",
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Export one clip, or a data set as one file."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.data.choice import some  # noqa: PLC0415
    from imgtransfer.exports import check_target, written_animation  # noqa: PLC0415

    if args.out.suffix.lower() == ".zip":
        for option, value in (("step", args.step), ("frames-as", args.frames_as)):
            if value is not None:
                raise InputError(f"--{option} {value}: a .zip holds every frame of every clip that is chosen")
        _pack(args, chosen_refs(args, args.source))
        return
    check_target(args.out)
    refs = chosen_refs(args, args.source)
    if len(refs) > 1:
        named = some([ref.name for ref in refs])
        raise InputError(f"{args.source}: export takes one clip; choose with --clip one of {named}")
    reader, step = refs[0].reader(), args.step or 1
    with (
        written_animation(args.out, n_frames=reader.n_frames, step=step, frames_as=args.frames_as) as add,
        tqdm(total=reader.n_frames, desc=reader.name, unit="frame", delay=2, disable=None) as bar,
    ):
        for part in reader.parts(_TOGETHER):
            add(part)
            bar.update(part.n_frames)
    print(f"{args.out}  {reader.name}: {len(range(0, reader.n_frames, step))} of {reader.n_frames} frames")


def _pack(args: argparse.Namespace, refs: Sequence[ClipRef]) -> None:
    from imgtransfer.data.packing import pack  # noqa: PLC0415
    from imgtransfer.data.store import DataSet  # noqa: PLC0415

    if any(ref.split is None for ref in refs):
        raise InputError(
            f"{args.source}: only a data set becomes one zip file; make one of clip npz files by `imgtransfer import`"
        )
    chosen = None if args.clip is None and args.split is None else [ref.name for ref in refs]
    packed = pack(DataSet.open(args.source), args.out, chosen)
    print(f"{args.out}  {len(packed)} clips, {args.out.stat().st_size / 1e6:.1f} MB")
