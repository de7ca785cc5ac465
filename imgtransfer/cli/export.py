"""`imgtransfer export`: a clip out of a data set, for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from render import InputError

if TYPE_CHECKING:
    from imgtransfer.data.clip import Clip
    from imgtransfer.data.mesh_output import MeshKind


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "export",
        help="write a clip as npz, animated GLB, OBJ or PLY files",
        description="Vertex order never changes: a garment imported with --weld comes out as its own file had it, with "
        "its texture coordinates and materials. The ending of --out chooses the form; a folder gets garment and body "
        "in every frame and in the rest pose, as `import meshes` reads them.",
    )
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    parser.add_argument(
        "clip",
        nargs="?",
        help="name of the clip, as `imgtransfer inspect SOURCE` lists it; not needed where there is one",
    )
    parser.add_argument(
        "--out", required=True, type=Path, help="FILE.npz, FILE.glb, or a folder for one file a frame"
    )
    parser.add_argument(
        "--frames-as",
        choices=("obj", "ply"),
        default="obj",
        help="form of the files in a folder; default obj",
    )
    parser.add_argument(
        "--step",
        type=int,
        help="take every so many frames; default 1, for GLB what gives about 10 MB at most",
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Export one clip."""
    from imgtransfer.data.clip import save_clip  # noqa: PLC0415
    from imgtransfer.data.source import open_clips  # noqa: PLC0415
    from imgtransfer.report.glb import animated_glb  # noqa: PLC0415

    if args.step is not None and (args.step < 1 or args.out.suffix.lower() == ".npz"):
        raise InputError(f"--step {args.step}: a whole number from 1 is wanted, and not with npz")
    clips = open_clips(args.source, names=None if args.clip is None else [args.clip])
    if len(clips) > 1:
        named = ", ".join(clip.name for clip in clips)
        raise InputError(f"{args.source}: export takes one clip; name one of {named}")
    kind = args.out.suffix.lower()
    if kind == ".npz":
        save_clip(args.out, clips[0])
    elif kind == ".glb":
        animated_glb(args.out, clips[0], step=args.step)
    elif kind:
        raise InputError(f"--out {args.out}: wanted is a name that ends in .npz or .glb, or a folder")
    else:
        _write_frames(args.out, clips[0], args.frames_as, args.step or 1)
    print(args.out)


def _write_frames(folder: Path, clip: Clip, kind: MeshKind, step: int) -> None:
    from imgtransfer.data.mesh_output import MeshFrames  # noqa: PLC0415
    from render import Mesh  # noqa: PLC0415
    from render.files import written_whole_folder  # noqa: PLC0415

    if folder.exists():
        raise InputError(f"--out {folder}: exists already; give the name of a new folder")
    # Named as `import meshes` and `simulate` look for them, rest pose included.
    meshes = {"body": (clip.body_vertices, Mesh(clip.body_rest, clip.body_faces), "body_rest")}
    if clip.garment_vertices is not None:
        meshes["garment"] = (clip.garment_vertices, clip.template, "template")
    with written_whole_folder(folder) as temporary:
        for name, (vertices, rest, still) in meshes.items():
            frames = MeshFrames(temporary, rest, kind, name=name, step=step)
            frames.add(vertices[::step])
            frames.add_still(still)
