"""`imgtransfer import`: everyone's clips into a data set."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from imgtransfer.cli.mesh_options import add_axes, add_objects, chosen_axes, chosen_motion_axes
from imgtransfer.cli.options import add_clip_names, add_dry_run
from render import InputError
from render.errors import one_line

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.importers.job import ImportOptions, Job

FORMATS = {
    "clips": "clip npz files, folders of them, or data sets (the default)",
    "meshes": "your own: a folder a clip with garment and body as OBJ or PLY frames, caches, Alembic or USD",
    "vto": "the VTO data set: .pkl files or folders of them; needs --smpl and --template",
    "tailornet": "the TailorNet data set: folders such as skirt_female, in their root",
    "cloth3d": "CLOTH3D: samples' folders, or folders of them; needs --smpl",
    "virtualbones": "the VirtualBones data set: folders with template.obj; needs --smpl",
}
# ImportOptions that not every format knows: argument -> formats.
_OF = {
    "fps": ("meshes", "vto", "tailornet", "cloth3d", "virtualbones"),
    "template": ("meshes", "vto"),
    "body_rest": ("meshes",),
    "garment_frames": ("meshes",),
    "body_frames": ("meshes",),
    "up": ("meshes",),
    "facing": ("meshes",),
    "unit": ("meshes",),
    "scale": ("meshes",),
    "garment_up": ("meshes",),
    "garment_facing": ("meshes",),
    "garment_unit": ("meshes",),
    "motion_up": ("meshes",),
    "motion_facing": ("meshes",),
    "motion_unit": ("meshes",),
    "garment_object": ("meshes",),
    "body_object": ("meshes",),
    "weld": ("meshes",),
    "anyway": ("meshes",),
    "smpl": ("vto", "tailornet", "cloth3d", "virtualbones"),
    "gender": ("vto", "cloth3d", "virtualbones"),
}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    formats = "\n".join(f"  {name:<13} {text}" for name, text in FORMATS.items())
    parser = subparsers.add_parser(
        "import",
        help="add clips to a data set: npz files, your own meshes, the public sets",
        usage="%(prog)s [FORMAT] PATH [PATH ...] --to DATASET [options]",
        description=f"The data set is made where there is none; clips that are in it already are skipped, so a "
        f"stopped run goes on. FORMAT is one of\n\n{formats}\n\ndocs/importing.md says how each must look.",
        examples=(
            "imgtransfer import meshes walk --to my_data.zarr --split train --garment shirt --up=z --unit=cm --weld",
            "imgtransfer import vto vto/tshirt/simulations --to vto.zarr --smpl SMPL --template tshirt.obj",
        ),
    )
    parser.add_argument("source", nargs="*", metavar="[FORMAT] PATH", help="what to import")
    parser.add_argument("--to", required=True, type=Path, metavar="DATASET", help="the data set's folder")
    parser.add_argument(
        "--split",
        help="such as train or test; the public sets have a standard one, the other formats need it",
    )
    parser.add_argument(
        "--garment", metavar="NAME", help="name of the garment in the data set; default from the files' names"
    )
    add_clip_names(parser)
    parser.add_argument("--fps", type=float, help="frames a second, where the files do not say; default 30")
    parser.add_argument("--title", default="", help="of a new data set")
    parser.add_argument("--licence", default="", help="of a new data set, such as CC-BY-4.0")
    parser.add_argument(
        "--source", dest="origin", default="", help="of a new data set: where the clips come from"
    )
    add_dry_run(parser, "what would be imported")
    _add_meshes(parser.add_argument_group("meshes"))
    body = parser.add_argument_group("SMPL bodies (vto, tailornet, cloth3d, virtualbones)")
    body.add_argument("--smpl", type=Path, metavar="FOLDER", help="your files of the SMPL model")
    body.add_argument(
        "--gender", choices=("female", "male", "neutral"), help="of the body; default the set's own"
    )
    return parser


def _add_meshes(group: argparse._ArgumentGroup) -> None:
    """Add what tells how meshes lie; axes that begin with a minus are written --facing=-y."""
    group.add_argument(
        "--garment-frames", metavar="PATH", help="one clip: folder, pattern or cache of the garment"
    )
    group.add_argument("--body-frames", metavar="PATH", help="one clip: folder, pattern or cache of the body")
    group.add_argument("--template", type=Path, metavar="FILE", help="the garment in the body's rest pose")
    group.add_argument("--body-rest", type=Path, metavar="FILE", help="the body in its rest pose")
    add_axes(group)
    add_objects(group, "garment", "body")
    group.add_argument(
        "--weld", action="store_true", help="join split seams; outputs still have the files' vertices and UVs"
    )
    group.add_argument("--anyway", action="store_true", help="import although the checks found something")


def run(args: argparse.Namespace) -> None:
    """Find out what there is to import, check it, and import it."""
    from imgtransfer.data.store import DataSet  # noqa: PLC0415
    from imgtransfer.importers.job import chosen, run_jobs  # noqa: PLC0415

    kind, paths = _kind(args)
    options = _options(args, kind)
    found = chosen(_jobs(args, kind, paths, options), options, " ".join(map(str, paths)) or kind)
    if args.dry_run:
        _tell(found, first=True)
        print(f"dry run  {len(found)} clips would be imported into {args.to}; nothing was written")
        return
    data = DataSet.open_or_create(args.to, title=args.title, licence=args.licence, source=args.origin)
    kept = run_jobs(found, data, options)
    _tell(found, first=False)
    for job in found:
        print(f"{job.name}  {data.clip_attributes(job.name).frames} frames  {one_line(job.split)}")
    already = f" ({kept} there already)" if kept else ""
    print(f"done     {len(found)} clips{already} in {args.to}")
    print(f"next     imgtransfer inspect {quote(str(args.to))}")


def _tell(jobs: Sequence[Job], *, first: bool) -> None:
    """Print what is taken; `first` reads the first clip where that is not known before."""
    from imgtransfer.importers.summary import clip_summary, told  # noqa: PLC0415

    known = [job.summary for job in jobs if job.summary is not None]
    if first and not known:
        for job in jobs:
            print(f"{job.name}  {one_line(job.split)}  from {', '.join(str(file) for file in job.files[:3])}")
        known = [clip_summary(f"{jobs[0].name}, the first of them", jobs[0].read())]
    if known:
        print(told(known))


def _kind(args: argparse.Namespace) -> tuple[str, list[Path]]:
    """The format, and the paths behind it; a first word that is no format is a path to clips."""
    words = list(args.source)
    kind = words.pop(0) if words and words[0] in FORMATS else "clips"
    single = args.garment_frames is not None or args.body_frames is not None
    if not words and not single:
        raise InputError(f"import {kind}: what to import? {FORMATS[kind]}")
    if single and (words or kind != "meshes" or args.garment_frames is None or args.body_frames is None):
        raise InputError(
            "import: --garment-frames and --body-frames go together, with meshes and without PATH"
        )
    for option, formats in _OF.items():
        if getattr(args, option) not in (None, False) and kind not in formats:
            raise InputError(f"import {kind}: --{option.replace('_', '-')} goes with {', '.join(formats)}")
    return kind, [Path(word) for word in words]


def _options(args: argparse.Namespace, kind: str) -> ImportOptions:
    from imgtransfer.importers.job import ImportOptions  # noqa: PLC0415

    if args.fps is not None and not 0 < args.fps < 1e4:
        raise InputError(f"--fps {args.fps}: a positive number of frames a second is wanted")
    for path in (args.template, args.body_rest):
        if path is not None and not path.exists():
            raise InputError(f"{path}: no such file; a mesh is wanted")
    axes, of_garment = chosen_axes(args)
    return ImportOptions(
        split=args.split,
        garment=args.garment,
        clips=tuple(args.clip) if args.clip else None,
        fps=args.fps,
        template=args.template,
        body_rest=args.body_rest,
        smpl=args.smpl,
        gender=args.gender,
        axes=axes,
        garment_axes=of_garment,
        motion_axes=chosen_motion_axes(args),
        garment_object=args.garment_object,
        body_object=args.body_object,
        weld=args.weld,
        anyway=args.anyway,
    )


def _jobs(args: argparse.Namespace, kind: str, paths: list[Path], options: ImportOptions) -> list[Job]:
    for path in paths:
        if kind != "clips" and not path.exists():
            raise InputError(f"{path}: no such file or folder; wanted is {FORMATS[kind]}")
    if args.garment_frames is None:
        return importlib.import_module(f"imgtransfer.importers.formats.{kind}").jobs(paths, options)
    from imgtransfer.importers.formats.meshes import job_of  # noqa: PLC0415
    from imgtransfer.importers.mesh_files import Source  # noqa: PLC0415
    from imgtransfer.importers.sequences import mesh_beside  # noqa: PLC0415

    garment, body = Path(args.garment_frames), Path(args.body_frames)
    name = garment.resolve().parent.name if garment.stem.startswith("garment") else garment.stem
    template = args.template or mesh_beside(garment, "garment")
    body_rest = args.body_rest or mesh_beside(body, "body")
    return [job_of(name, Source(garment, body, template, body_rest), options)]
