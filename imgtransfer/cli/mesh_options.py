"""Command-line arguments that say how the coordinates of the user's meshes lie."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.importers.checks.axes import Axes, MotionAxes


OF_AXES = ("up", "facing", "unit", "scale")  # as `add_axes` calls them
OBJECTS = ("garment_object", "body_object")  # as `add_objects` calls them
OF_GARMENT_AXES = ("garment_up", "garment_facing", "garment_unit")
OF_MOTION_AXES = ("motion_up", "motion_facing", "motion_unit")
OF_SEQUENCES = ("body_rest", "fps", "body_object", *OF_MOTION_AXES)  # of the body's own meshes in motion


def add_axes(group: argparse._ArgumentGroup) -> None:
    """Add --up, --facing, --unit, --scale, the garment's own and the frames'; a minus needs an equals sign: --up=-y."""
    axes = "x, y, z, -x, -y or -z"
    group.add_argument("--up", help=f"the files' axis that points up: {axes}; default y")
    group.add_argument(
        "--facing", help="the axis that the body faces in its rest pose, such as --facing=-y; default z"
    )
    group.add_argument("--unit", help="the files' unit: m, cm, mm, dm, in or ft; default m")
    group.add_argument("--scale", type=float, help="metres a unit of the files, in place of --unit")
    for what in ("up", "facing", "unit"):
        group.add_argument(
            f"--garment-{what}", help=f"--{what} of the garment's files, where it is not the body's"
        )
        group.add_argument(
            f"--motion-{what}",
            help=f"--{what} of the frames, where it is not the rest meshes': of caches, say",
        )


def chosen_motion_axes(args: argparse.Namespace) -> MotionAxes:
    """How the frames lie where that is otherwise than the rest meshes.

    Raises:
        InputError: an unknown axis or unit.
    """
    from imgtransfer.importers.checks.axes import AXES, MotionAxes  # noqa: PLC0415

    for option in ("motion_up", "motion_facing"):
        value = getattr(args, option)
        if value is not None and value not in AXES:
            raise InputError(f"--{option.replace('_', '-')} {value}: one of {', '.join(AXES)} is wanted")
    return MotionAxes(args.motion_up, args.motion_facing, _metres("--motion-unit", args.motion_unit))


def add_objects(group: argparse._ArgumentGroup, *kinds: str) -> None:
    """Add --garment-object and the like, for each of the kinds of mesh."""
    for kind in kinds:
        group.add_argument(
            f"--{kind}-object",
            metavar="NAME",
            help=f"which mesh of an Alembic or USD file (extras alembic, usd) is the {kind}: its name or path; "
            "default the only one",
        )


def chosen_axes(args: argparse.Namespace) -> tuple[Axes, Axes | None]:
    """How the body's files lie, and the garment's where it is otherwise.

    Raises:
        InputError: an unknown axis or unit, or --unit with --scale.
    """
    from imgtransfer.importers.checks.axes import Axes, usual_facing  # noqa: PLC0415

    if args.unit is not None and args.scale is not None:
        raise InputError("--unit and --scale say the same; give one of them")
    scale = args.scale if args.scale is not None else _metres("--unit", args.unit) or 1.0
    given = {name for name in ("up", "facing") if getattr(args, name)}
    given |= {"scale"} if args.unit or args.scale is not None else set()
    up = args.up or "y"
    axes = Axes(up, args.facing or usual_facing(up), scale, frozenset(given))
    if not (args.garment_up or args.garment_facing or args.garment_unit):
        return axes, None
    given |= {name for name in ("up", "facing") if getattr(args, f"garment_{name}")}
    given |= {"scale"} if args.garment_unit else set()
    up = args.garment_up or axes.up
    facing = args.garment_facing or (axes.facing if up == axes.up else usual_facing(up))
    metres = _metres("--garment-unit", args.garment_unit) or scale
    return axes, Axes(up, facing, metres, frozenset(given))


def check_axes_used(args: argparse.Namespace, *, body: bool, garment: bool, wanted: str) -> None:
    """Raise InputError where an option of `add_axes` would do nothing.

    Args:
        body, garment: whether there are mesh files of a body and of a garment.
        wanted: what the options go with, for the message.
    """
    given = [
        option
        for option in (*OF_AXES, *OF_GARMENT_AXES, *OF_MOTION_AXES)
        if getattr(args, option) is not None
    ]
    if not (body or garment):
        unused = given
    elif not garment:
        unused = [option for option in given if option in OF_GARMENT_AXES]
    elif not body:
        said = {option.removeprefix("garment_") for option in given if option in OF_GARMENT_AXES}
        said |= {"scale"} & ({"scale"} if "unit" in said else set())
        unused = [option for option in given if option in said]
    else:
        unused = []
    if unused:
        raise InputError(f"--{unused[0].replace('_', '-')} does nothing here: it goes with {wanted}")


def _metres(option: str, unit: str | None) -> float | None:
    from imgtransfer.importers.checks.axes import UNITS  # noqa: PLC0415

    if unit is not None and unit not in UNITS:
        raise InputError(f"{option} {unit}: one of {', '.join(UNITS)} is wanted; or give --scale METRES")
    return None if unit is None else UNITS[unit]
