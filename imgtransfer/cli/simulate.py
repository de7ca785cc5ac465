"""`imgtransfer simulate`: cloth simulation of motions, or on the user's own moving body, into a data set."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imgtransfer.cli.mesh_options import OF_AXES, OF_SEQUENCES, add_axes, add_objects, chosen_axes
from imgtransfer.cli.options import (
    add_changes,
    add_clip_names,
    add_dry_run,
    add_runner,
    chosen_executor,
    refuse_twice,
)
from imgtransfer.running.messages import as_flag
from render import InputError
from render.options import Option, options_named

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.simulation.config import SimulateConfig

_OF_GARMENT = (
    *("garment", "pinned", "anyway", "garment_up", "garment_facing", "garment_unit", "garment_object"),
)
_OF_TEMPLATE = ("weld", "pinned", "anyway")  # keys of a garment's own mesh that are options, too
_OF_BODY = {"smpl": "path", "gender": "gender"}  # what importers call a SMPL body's settings
_DECIDED = {  # by options, in place of the configuration
    "template": ("garment", "garments"),
    "unit": ("sequences.unit", "sequences.scale"),
    "scale": ("sequences.unit", "sequences.scale"),
    "joints": ("files.joints",),
    **{name: (f"sequences.{name}",) for name in ("up", "facing", "weld", *OF_SEQUENCES)},
}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """The command's arguments."""
    parser = subparsers.add_parser(
        "simulate",
        help="simulate a garment, the project's or your own, on a body for a list of motions, or on your own body",
        description="Clips that the data set holds already are left as they are, so a stopped run goes on. Those that "
        "fail their quality gates are listed in the data set, and tried again only with other settings.",
        examples=(
            "imgtransfer simulate configs/data/sample.yaml --out sample.zarr --workers 2",
            "imgtransfer simulate walk --template shirt.obj --up=z --unit=cm --weld --out mine.zarr",
        ),
    )
    parser.add_argument(
        "sources",
        nargs="*",
        type=Path,
        metavar="CONFIG_OR_SOURCE",
        help="a YAML file such as configs/data/sample.yaml, and/or motion files (AMASS-style npz, BVH), and/or body "
        "mesh sequences (a folder with body/ frames or body.pc2 and body_rest.obj, as `import meshes` reads them, or "
        "an Alembic or USD file), "
        "or folders of either",
    )
    parser.add_argument(
        "--joints",
        type=Path,
        metavar="FILE",
        help="YAML of what BVH skeletons call SMPL's joints, where their names do not tell (left_knee: Bone07)",
    )
    parser.add_argument("--out", type=Path, required=True, help="the data set, made where it does not exist")
    parser.add_argument("--frames", type=int, help="only the first FRAMES frames of each motion")
    add_clip_names(parser)
    add_dry_run(parser, "which clips would be simulated")
    add_changes(parser, "cloth.fabric=silk, --set clips.0.seed=3")
    _add_meshes(parser.add_argument_group("your own garment and body"))
    add_runner(parser)
    return parser


def _add_meshes(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--template",
        type=Path,
        metavar="FILE",
        help="your garment (OBJ, PLY, GLB, STL, Alembic or USD) in the body's rest pose, in place of the "
        "configuration's garments",
    )
    group.add_argument("--garment", metavar="NAME", help="its name in the data set; default the file's")
    group.add_argument(
        "--pinned", action="store_true", help="its topmost opening is a waistband, which stays on the skin"
    )
    group.add_argument(
        "--weld", action="store_true", help="join split seams; outputs still have the file's vertices and UVs"
    )
    group.add_argument("--anyway", action="store_true", help="go on although the checks found something")
    add_axes(group)
    add_objects(group, "garment", "body")
    group.add_argument(
        "--body-rest", type=Path, metavar="FILE", help="a mesh sequence's body in its rest pose"
    )
    group.add_argument(
        "--fps", type=float, help="frames a second of mesh sequences whose files do not say; default 30"
    )


def run(args: argparse.Namespace) -> None:
    """Simulate, and say where the data set is."""
    from imgtransfer.config.loader import load_config  # noqa: PLC0415
    from imgtransfer.importers.summary import told  # noqa: PLC0415
    from imgtransfer.simulation.config import SimulateConfig  # noqa: PLC0415
    from imgtransfer.simulation.planning.job import simulate  # noqa: PLC0415
    from imgtransfer.simulation.planning.overview import plan_lines, summaries_of  # noqa: PLC0415
    from imgtransfer.simulation.planning.plan import plan  # noqa: PLC0415
    from imgtransfer.simulation.planning.sources import sorted_sources  # noqa: PLC0415
    from render.extras import check_installed  # noqa: PLC0415

    check_installed("simulate", "simulate", "newton", "gpytoolbox")
    executor = chosen_executor(args)
    configs = [path for path in args.sources if path.suffix in (".yaml", ".yml")]
    if len(configs) > 1:
        raise InputError(f"one configuration at a time, found {', '.join(str(path) for path in configs)}")
    refuse_twice(args, _DECIDED)
    config = _with_meshes(args, load_config(SimulateConfig, configs[0] if configs else None, args.set))
    sources = [path for path in args.sources if path not in configs]
    motions, sequences = sorted_sources(sources)
    _check_used(
        args, sequences=bool(sequences), bvh=any(file.path.suffix.lower() == ".bvh" for file in motions)
    )
    source = str(configs[0]) if configs else "simulate"
    with options_named(as_option_with_template if args.template is not None else as_option):
        tasks = plan(config, sources, frames=args.frames, clips=args.clip, source=source)
        if summaries := summaries_of(tasks):
            print(told(summaries))
        if args.dry_run:
            for line in plan_lines(tasks, args.out):
                print(line)
            return
        rejected = simulate(tasks, args.out, executor=executor)
    print(f"{len(tasks) - len(rejected)} of {len(tasks)} clips stand, {len(rejected)} rejected")
    for name, reason in rejected.items():
        print(f"  {name}: {reason}")
    print(f"data set {args.out}")
    print(f"next     imgtransfer inspect {args.out}")


def as_option(option: Option) -> str:
    """An option of the garment or body as the configuration has it, `garment.unit: cm`; any other as a flag."""
    key = option.name.removeprefix("garment_")
    if key == option.name and key not in _OF_TEMPLATE:
        return as_option_with_template(option)
    return _as_setting(f"garment.{key}", option)


def as_option_with_template(option: Option) -> str:
    """The same where the garment is an argument, and so has flags; a SMPL body's files are always a setting."""
    key = _OF_BODY.get(option.name)
    return as_flag(option) if key is None else _as_setting(f"body.{key}", option)


def _as_setting(key: str, option: Option) -> str:
    value = "true" if option.value is True else option.value
    return f"`{key}`" if value is None else f"`{key}: {value}`"


def _with_meshes(args: argparse.Namespace, config: SimulateConfig) -> SimulateConfig:
    """The configuration with what the arguments say of the user's meshes.

    Raises:
        InputError: values that make no sense, or files that are not there.
    """
    from imgtransfer.cli.mesh_settings import (  # noqa: PLC0415
        garment_settings,
        with_joints,
        with_sequence_options,
    )

    _check_values(args)
    axes, of_garment = chosen_axes(args)
    of_garment = of_garment or axes
    changes: dict[str, Any] = {}
    if args.joints is not None:
        changes["files"] = with_joints(config.files, args.joints)
    if (sequences := with_sequence_options(config.sequences, args, axes)) is not None:
        changes["sequences"] = sequences
    if args.template is not None:
        garment = garment_settings(args.template, args, of_garment, name=args.garment)
        # Whatever garments a clip was meant for, this is the only one now.
        clips = tuple(clips.model_copy(update={"garments": ()}) for clips in config.clips)
        changes |= {"garment": garment, "garments": (), "clips": clips}
    return config.model_copy(update=changes)


def _check_used(args: argparse.Namespace, *, sequences: bool, bvh: bool) -> None:
    """Raise InputError where an argument would do nothing: without --template, mesh sequences, or BVH files."""
    needs = {
        "BVH files; npz files have SMPL's joints": () if bvh else ("joints",),
        "--template FILE; a configuration's garment has its own settings": (
            () if args.template is not None else _OF_GARMENT
        ),
        "body mesh sequences; a configuration's `fps` is the simulation's own": (
            () if sequences else OF_SEQUENCES
        ),
        "--template FILE or body mesh sequences": (
            () if sequences or args.template is not None else (*OF_AXES, "weld")
        ),
    }
    for what, options in needs.items():
        for option in options:
            if getattr(args, option):
                raise InputError(f"--{option.replace('_', '-')} goes with {what}")


def _check_values(args: argparse.Namespace) -> None:
    import re  # noqa: PLC0415

    from imgtransfer.garments.config import NAME  # noqa: PLC0415

    if args.garment is not None and not re.fullmatch(NAME, args.garment):
        raise InputError(f"--garment {args.garment}: a name of letters, digits, '_', '-' and '.' is wanted")
    if args.fps is not None and not 0 < args.fps < 1e4:
        raise InputError(f"--fps {args.fps}: a positive number of frames a second is wanted")
    for option, path in (("--template", args.template), ("--body-rest", args.body_rest)):
        if path is not None and not path.is_file():
            raise InputError(f"{option} {path}: no such file; a mesh is wanted")
