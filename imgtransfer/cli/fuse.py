"""`imgtransfer fuse`: maps to meshes, those of `imgtransfer predict` and those that another model made."""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING

from imgtransfer.cli.mesh_options import (
    OBJECTS,
    OF_AXES,
    OF_GARMENT_AXES,
    OF_MOTION_AXES,
    add_axes,
    add_objects,
)
from imgtransfer.cli.options import (
    add_changes,
    add_clip_names,
    add_runner,
    chosen_executor,
    refuse_twice,
)
from imgtransfer.pipeline.folder import (
    FUSED_FILE,
    HISTORY_FILE,
    REPORT_FILE,
    check_replaceable,
    clip_of_folder,
    predicted_clips,
)
from render import InputError
from render.limits import MAX_LENGTH

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.pipeline.fuse import FuseOptions

# Options of the form with --maps.
SINGLE = (
    *("out", "template", "initial", "body", "inner", "pins"),
    *(*OF_AXES, *OF_GARMENT_AXES, *OF_MOTION_AXES, *OBJECTS, "inner_object", "weld"),
)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "fuse",
        help="recover meshes from position and normal maps",
        usage="%(prog)s PREDICTIONS [options]\n       %(prog)s --maps FILE --out DIR [options]",
        description=f"Recovers the garment's vertices and writes them, in world coordinates, to {FUSED_FILE}, with "
        f"the report {REPORT_FILE}. For PREDICTIONS they are put beside the maps of each clip; clips that are fused "
        "with the same settings already are left as they are, so a stopped run goes on. With --maps, one map file "
        "of any program is fused; docs/fusion.md goes through an example, docs/maps.md describes the file.",
        examples=(
            "imgtransfer fuse predictions --clip 'tshirt/*' --workers 2",
            "imgtransfer fuse --maps maps.npz --body body.npz --set weight_edge=50 --out result",
        ),
    )
    parser.add_argument(
        "predictions",
        nargs="?",
        type=Path,
        metavar="PREDICTIONS",
        help="what `imgtransfer predict` wrote, or one clip's folder in it",
    )
    add_clip_names(parser)
    parser.add_argument("--overwrite", action="store_true", help="fuse clips again that are fused already")
    parser.add_argument("--config", type=Path, help="YAML with the fusion's hyper-parameters that differ")
    add_changes(parser, "weight_edge=50")
    parser.add_argument(
        "--solver",
        choices=("local_global", "adam"),
        help="in place of the configuration's: local_global (fast), or adam (the paper's schedule)",
    )
    parser.add_argument(
        "--smooth-time",
        type=float,
        metavar="SECONDS",
        help="take jitter out of the motion, without lag: oscillations of this period, such as 0.15, are halved, "
        "slower ones stay, faster ones go; default 0, each frame by itself",
    )
    parser.add_argument("--positions-only", action="store_true", help="leave the normal maps out")
    parser.add_argument(
        "--erode",
        type=int,
        default=0,
        metavar="PIXELS",
        help="how many pixels along the maps' outlines not to trust, where they are blurred with the background; "
        "default 0",
    )
    parser.add_argument("--meshes", choices=("obj", "ply"), help="also write one mesh file a frame")
    parser.add_argument(
        "--history",
        action="store_true",
        help=f"also report every term at every iteration, and draw the curves: {HISTORY_FILE}",
    )
    parser.add_argument(
        "--device", default="cpu", help="torch device that computes: cpu or cuda; default cpu"
    )
    add_runner(parser)
    _add_single(parser.add_argument_group("one map file, in place of PREDICTIONS"))
    return parser


def _add_single(group: argparse._ArgumentGroup) -> None:
    """Options that only go with --maps. Everything is in world coordinates, metres."""
    group.add_argument("--maps", type=Path, metavar="FILE", help="map file: npz, or a folder of EXR files")
    group.add_argument("--out", type=Path, metavar="DIR", help="folder for the results")
    group.add_argument("--template", type=Path, help="mesh in place of the map file's template")
    group.add_argument(
        "--body",
        type=Path,
        help="what the garment is kept out of: npz with body_faces and body_vertices (frames, vertices, 3), a clip "
        "npz, mesh files (one, a folder or a pattern of them, a frame each), a point cache, or an Alembic or USD file",
    )
    group.add_argument(
        "--initial",
        type=Path,
        help="garment to start from in place of the position maps: npz with garment_faces and garment_vertices, a "
        "clip npz, mesh files, a point cache, or an Alembic or USD file, as for --body",
    )
    group.add_argument(
        "--inner", type=Path, help="another garment, worn beneath, to stay outside of; files as for --initial"
    )
    group.add_argument(
        "--pins",
        type=Path,
        help="vertices that stay in place: a text file of their numbers, counted from 0, or an npz with indices (P,) "
        "and, to say where, positions (P, 3) or (frames, P, 3)",
    )
    add_axes(group)
    add_objects(group, "garment", "body", "inner")
    group.add_argument(
        "--weld",
        action="store_true",
        help="join the split seams of --template, as `imgtransfer render --weld` did for the maps; --initial and "
        "--pins then have the file's vertices, and so have the meshes that are written",
    )


def run(args: argparse.Namespace) -> None:
    """Fuse one map file, or every clip of a prediction."""
    from fusion.config import FusionConfig  # noqa: PLC0415
    from imgtransfer.config.loader import load_config  # noqa: PLC0415
    from imgtransfer.pipeline.fuse import FuseOptions  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_summary import FusedClip, summary  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_task import FuseTask, frames_to_fuse, fuse_clip  # noqa: PLC0415
    from imgtransfer.running import run_tasks  # noqa: PLC0415

    _check_form(args)
    _check_device(args.device)
    refuse_twice(args, {"solver": ("solver",), "smooth_time": ("smooth_time_s",)})
    changes = [*args.set, *([f"solver={args.solver}"] if args.solver else [])]
    if args.smooth_time is not None:
        changes.append(f"smooth_time_s={args.smooth_time}")
    config = load_config(FusionConfig, args.config, changes)
    options = FuseOptions(config=config, positions_only=args.positions_only, erode=args.erode)
    if args.maps is not None:
        _fuse_file(args, options)
        return
    executor = chosen_executor(args)
    tasks = [
        FuseTask(
            folder=folder.resolve() if args.ray else folder,  # another machine's have another working folder
            options=options,
            meshes=args.meshes,
            device=args.device,
            history=args.history,
            overwrite=args.overwrite,
        )
        for folder in _chosen(args)
    ]
    done = run_tasks(
        fuse_clip,
        tasks,
        executor=executor,
        name=lambda task: task.name,
        say=FusedClip.line,
        unit="frame",
        size=frames_to_fuse,
    )
    if done.values:
        print(summary(done.values.values()))
    done.check()
    choice = [word for name in args.clip or () for word in ("--clip", name)]
    print(
        f"next     {join(['imgtransfer', 'evaluate', str(args.predictions), '--truth', 'SOURCE', *choice])}"
    )


def _check_form(args: argparse.Namespace) -> None:
    """Raise InputError unless the arguments are those of one form."""

    if (args.predictions is None) == (args.maps is None):
        raise InputError("fuse: give either PREDICTIONS or --maps FILE --out DIR")
    if not 0 <= args.erode <= MAX_LENGTH:
        raise InputError(f"--erode {args.erode}: a whole number of pixels from 0 to {MAX_LENGTH} is wanted")
    if args.maps is None:
        for option in SINGLE:
            if getattr(args, option) not in (None, False):
                name = option.replace("_", "-")
                raise InputError(f"fuse: --{name} goes with --maps; PREDICTIONS have that in their folders")
    elif args.ray is not None or args.workers != 1:
        raise InputError("fuse: --workers and --ray go with PREDICTIONS; --maps is one clip")
    elif args.clip is not None:
        raise InputError("fuse: --clip goes with PREDICTIONS; --maps is one clip")
    elif args.out is None:
        raise InputError("fuse: --maps needs --out DIR, the folder for the results")
    elif args.overwrite:
        raise InputError("fuse: --overwrite goes with PREDICTIONS; what --maps wrote to --out is replaced")


def _chosen(args: argparse.Namespace) -> list[Path]:
    """The folders of the predicted clips that --clip chooses."""
    from imgtransfer.data.choice import choose  # noqa: PLC0415

    # Whatever the folder's path as it was given ("." for instance), its name is the clip's.
    folders = {clip_of_folder(folder.resolve().name): folder for folder in predicted_clips(args.predictions)}
    return [folders[name] for name in choose(args.predictions, list(folders), names=args.clip)]


def _check_device(device: str) -> None:
    import torch  # noqa: PLC0415

    try:
        if torch.zeros(1, device=device).sum().item() != 0:
            raise RuntimeError("it does not compute")
    except (RuntimeError, AssertionError, ImportError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {device}: not usable here ({reason}); use cpu") from error


def _fuse_file(args: argparse.Namespace, options: FuseOptions) -> None:
    """Fuse --maps; the folder --out appears whole or not at all."""
    from imgtransfer.cli.fuse_files import given_files  # noqa: PLC0415
    from imgtransfer.importers.summary import motion_text, size_text  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_task import fuse_file  # noqa: PLC0415
    from imgtransfer.report.fusion_history import fusion_table  # noqa: PLC0415
    from render.files.atomic import written_whole_folder  # noqa: PLC0415

    check_replaceable(args.out)
    inputs = given_files(args)
    for name in ("body", "initial", "inner"):
        if (moving := getattr(inputs, name)) is not None:
            print(f"{name:<8} {motion_text(moving)}; {size_text(moving.mesh)}")
    files = (args.template, args.initial, args.body, args.inner, args.pins)
    with written_whole_folder(args.out) as folder:
        report = fuse_file(
            args.maps,
            folder,
            inputs,
            options,
            sources=[file for file in files if file is not None],
            meshes=args.meshes,
            device=args.device,
            history=args.history,
        )
    print(fusion_table(report))
    print(f"results  {args.out}: {', '.join(sorted(entry.name for entry in args.out.iterdir()))}")
