"""`imgtransfer render`: clips and meshes as maps, for other programs and for eyes."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.mesh_options import (
    OBJECTS,
    OF_AXES,
    OF_GARMENT_AXES,
    OF_MOTION_AXES,
    add_axes,
    add_objects,
    check_axes_used,
    chosen_axes,
    chosen_motion_axes,
)
from imgtransfer.cli.options import (
    add_clip_choice,
    add_views,
    chosen_refs,
    frame_slice,
    image_size,
)
from imgtransfer.pipeline.folder import folder_of_clip
from render import InputError

if TYPE_CHECKING:
    from imgtransfer.data.canonical import RootMode
    from imgtransfer.data.source import ClipRef
    from imgtransfer.pipeline.render import RenderOptions
    from imgtransfer.pipeline.scene import Scene

MESH_OPTIONS = (
    "body",
    "body_template",
    "fps",
    *OF_AXES,
    *OF_GARMENT_AXES,
    *OF_MOTION_AXES,
    *OBJECTS,
    "weld",
)  # only with --template


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "render",
        help="write the maps of clips or meshes, as npz or EXR and as PNG sheets",
        usage="%(prog)s SOURCE --out DIR [options]\n"
        "       %(prog)s FRAMES --template FILE [--body FRAMES --body-template FILE] --out DIR [options]",
        description="For each clip a folder with the maps of garment and body, and sheets for eyes: positions and "
        "normals; mask, depth and visibility; frames over time; and with --against the difference. Garment and body "
        "are seen by the same cameras and encoded by the garment's box. docs/maps.md describes the files.",
        examples=(
            "imgtransfer render configs/sample_data/tshirt.zarr.zip --clip '*walk*' --frames 0:60:10 --out maps",
            "imgtransfer render 'walk/*.obj' --template shirt.obj --up=z --unit=cm --views four --out maps",
        ),
    )
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="data set, clip npz or folder of clip npz; with --template one mesh, a folder with one a frame, a "
        "pattern in quotes, such as 'out/shirt_*.obj', a point cache, or an npz with garment_faces and "
        "garment_vertices",
    )
    parser.add_argument("--out", required=True, type=Path, help="folder for the results")
    add_clip_choice(parser)
    parser.add_argument("--frames", default=":", help="one number, or START:STOP:STEP; default all")
    parser.add_argument("--size", default="256", help="pixels: 256, or HEIGHTxWIDTH; default 256")
    add_views(parser)
    parser.add_argument(
        "--format", choices=("npz", "exr"), default="npz", help="of the maps; exr makes a folder of images"
    )
    parser.add_argument(
        "--against", metavar="OTHER", help="a source of the same meshes, to draw the distance between the two"
    )
    parser.add_argument(
        "--root",
        choices=("heading", "root"),
        help="what the canonical frame removes: the heading, or the whole root rotation; default heading",
    )
    parser.add_argument(
        "--backend",
        choices=("auto", "egl", "osmesa", "numpy"),
        default="auto",
        help="what rasterises; default the first that works",
    )
    meshes = parser.add_argument_group("plain mesh files")
    meshes.add_argument(
        "--template", type=Path, help="the garment at rest; SOURCE is then the garment in motion"
    )
    meshes.add_argument("--body", type=Path, metavar="FRAMES", help="the body in motion")
    meshes.add_argument("--body-template", type=Path, metavar="FILE", help="the body at rest")
    meshes.add_argument("--fps", type=float, help="frames a second, for the map files; default 30")
    add_axes(meshes)
    add_objects(meshes, "garment", "body")
    meshes.add_argument(
        "--weld", action="store_true", help="join split seams, so that normals are smooth across them"
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Render everything that is asked for; the folder of each appears whole or not at all."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.pipeline.render import RenderOptions, render_scene  # noqa: PLC0415

    options = RenderOptions(
        size=image_size(args.size),
        views=args.views,
        layers=args.layers or 1,
        backend=args.backend,
        file_format=args.format,
    )
    for scene, other in _scenes(args):
        for line in scene.taken:
            print(line)
        target = args.out / folder_of_clip(scene.name)
        total = scene.n_frames * len(scene.meshes)
        with tqdm(total=total, desc=scene.name, unit="frame", disable=None) as bar:
            distances = render_scene(scene, target, options, against=other, progress=bar.update)
        print(_summary(target, scene, options))
        for name, distance in distances.items():
            print(f"  {name}: {distance.mean():.3f} mm apart on average, {distance.max():.3f} mm at most")


def _summary(target: Path, scene: Scene, options: RenderOptions) -> str:
    meshes = " and ".join(f"{name}{'.npz' if options.file_format == 'npz' else '/'}" for name in scene.meshes)
    return f"{target}  {scene.n_frames} frames: {meshes}, sheets as .png"


def _scenes(args: argparse.Namespace) -> Iterator[tuple[Scene, Scene | None]]:
    """Every scene that is asked for and, if wanted, what to compare it with; one in memory at a time."""
    if args.template is not None:
        yield _meshes(args, args.source), None if args.against is None else _meshes(args, args.against)
        return
    given = [
        f"--{name.replace('_', '-')}" for name in MESH_OPTIONS if getattr(args, name) not in (None, False)
    ]
    if given:
        raise InputError(f"{', '.join(given)}: only for plain meshes, together with --template")
    _check_no_meshes(args.source)
    from imgtransfer.pipeline.scene import clip_scene  # noqa: PLC0415

    refs = chosen_refs(args, args.source)
    others = {} if args.against is None else _others(args.against, refs)
    root: RootMode = args.root or "heading"
    for ref in refs:
        other = _cut(args, clip_scene(others[ref.name].load(), root)) if others else None
        yield _cut(args, clip_scene(ref.load(), root)), other


def _others(source: str, refs: Sequence[ClipRef]) -> dict[str, ClipRef]:
    """The clip to compare each one with: of the same name, or the only one with the only one."""
    from imgtransfer.data.source import clip_refs  # noqa: PLC0415

    refs_by_name = {ref.name: ref for ref in clip_refs(source)}
    if len(refs) == len(refs_by_name) == 1:
        return {refs[0].name: next(iter(refs_by_name.values()))}
    lost = [ref.name for ref in refs if ref.name not in refs_by_name]
    if lost:
        raise InputError(
            f"--against {source}: no clip {', '.join(lost)} in it; it has {', '.join(refs_by_name)}"
        )
    return refs_by_name


def _meshes(args: argparse.Namespace, frames: str) -> Scene:
    from imgtransfer.pipeline.scene import mesh_scene  # noqa: PLC0415
    from render.limits import check_rate  # noqa: PLC0415

    if args.split is not None or args.clip is not None:
        raise InputError("--split and --clip choose among clips; with --template there are none")
    check_axes_used(
        args, body=args.body is not None, garment=True, wanted="a body; without one --garment-... says it all"
    )
    axes, garment_axes = chosen_axes(args)
    fps = 30.0 if args.fps is None else args.fps
    check_rate(fps, "--fps")
    scene = mesh_scene(
        args.template,
        Path(frames),
        body_template=args.body_template,
        body=args.body,
        root=args.root,
        fps=fps,
        axes=axes,
        garment_axes=garment_axes,
        motion_axes=chosen_motion_axes(args),
        garment_object=args.garment_object,
        body_object=args.body_object,
        welding=args.weld,
    )
    return _cut(args, scene)


def _cut(args: argparse.Namespace, scene: Scene) -> Scene:
    frames = frame_slice(args.frames)
    if len(range(scene.n_frames)[frames]) == 0:
        raise InputError(f"--frames {args.frames}: {scene.name} has {scene.n_frames} frames, none of these")
    return scene.cut(frames)


def _check_no_meshes(source: str) -> None:
    """Meshes without --template would be taken for a broken clip."""
    from render.files.mesh_files import SUFFIXES as MESHES  # noqa: PLC0415
    from render.files.point_caches import SUFFIXES as CACHES  # noqa: PLC0415
    from render.files.scenes.reader import SUFFIXES as SCENES  # noqa: PLC0415

    path = Path(source)
    entries = [path, *(path.iterdir() if path.is_dir() else ())]
    suffixes = {entry.suffix.lower() for entry in entries}
    if suffixes & {*MESHES, *CACHES, *SCENES} and ".npz" not in suffixes:
        raise InputError(f"{source}: meshes are rendered with --template FILE, the garment at rest")
