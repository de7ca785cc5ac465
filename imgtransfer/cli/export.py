"""`imgtransfer export`: a clip out of a data set, for other programs."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, at_least_one, chosen_refs
from render import InputError

if TYPE_CHECKING:
    from imgtransfer.data.mesh_output import MeshKind
    from imgtransfer.data.reader import Reader
    from imgtransfer.data.source import ClipRef

_TOGETHER = 32  # frames that are read together


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "export",
        help="write a clip as npz, animated GLB, OBJ or PLY files, or a data set as one zip file",
        description="Vertex order never changes: a garment imported with --weld comes out as its own file had it, with "
        "its texture coordinates and materials. The ending of --out chooses the form; a folder gets garment and body "
        "in every frame and in the rest pose, as `import meshes` reads them; a .zip gets every clip that is chosen, as "
        "a data set in one file, which all commands read where it lies.",
        examples=(
            "imgtransfer export configs/sample_data/tshirt.zarr.zip --clip tshirt/walk_s104 --out walk.glb",
            "imgtransfer export my_data.zarr --out my_data.zarr.zip",
        ),
    )
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    add_clip_choice(parser)
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        help="FILE.npz, FILE.glb, DATA.zarr.zip, or a folder for one file a frame",
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
    """Export one clip."""
    from imgtransfer.data.choice import some  # noqa: PLC0415
    from imgtransfer.data.clip import written_clip  # noqa: PLC0415
    from imgtransfer.report.glb import animated_glb  # noqa: PLC0415

    kind = args.out.suffix.lower()
    if kind not in ("", ".npz", ".glb", ".zip"):
        raise InputError(
            f"--out {args.out}: wanted is a name that ends in .npz or .glb, or .zip for every clip, or a folder"
        )
    if kind in (".npz", ".zip") and args.step is not None:
        raise InputError(f"--step {args.step}: a {kind} holds every frame; --step goes with .glb and folders")
    if kind and args.frames_as is not None:
        raise InputError(f"--frames-as {args.frames_as}: goes with a folder, but --out is {args.out}")
    refs = chosen_refs(args, args.source)
    if kind == ".zip":
        _pack(args, refs)
        return
    if len(refs) > 1:
        named = some([ref.name for ref in refs])
        raise InputError(f"{args.source}: export takes one clip; choose with --clip one of {named}")
    reader, step = refs[0].reader(), args.step or 1
    if kind == ".npz":
        with written_clip(args.out) as add:
            for part in reader.parts(_TOGETHER):
                add(part)
    elif kind == ".glb":
        animated_glb(args.out, reader.clip(), step=step)
    else:
        _write_frames(args.out, reader, args.frames_as or "obj", step)
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


def _write_frames(folder: Path, reader: Reader, kind: MeshKind, step: int) -> None:
    from imgtransfer.data.mesh_output import MeshFrames  # noqa: PLC0415
    from render import Mesh  # noqa: PLC0415
    from render.files.atomic import written_whole_folder  # noqa: PLC0415

    if folder.exists():
        raise InputError(f"--out {folder}: exists already; give the name of a new folder")
    clip = reader.clip(0, 1)
    # Named as `import meshes` and `simulate` look for them, rest pose included.
    meshes = {"body": (Mesh(clip.body.rest, clip.body.faces), "body_rest")}
    if clip.garment is not None:
        meshes["garment"] = (clip.template_mesh, "template")
    with written_whole_folder(folder) as temporary:
        writers = {}
        for name, (rest, still) in meshes.items():
            writers[name] = MeshFrames(temporary, rest, kind, name=name, step=step)
            writers[name].add_still(still)
        done = 0
        for part in reader.parts(_TOGETHER):
            for name, writer in writers.items():
                moved = part.body if name == "body" else part.garment
                assert moved is not None  # as in the first frame
                writer.add(moved.vertices[-done % step :: step])
            done += part.n_frames
