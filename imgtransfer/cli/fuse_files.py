"""The files that `imgtransfer fuse --maps` is given beside the maps, in metres, y up, seams joined if wanted."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from imgtransfer.cli.mesh_options import check_axes_used, chosen_axes, chosen_motion_axes
from imgtransfer.data.sequences import Kind, clip_reader
from imgtransfer.importers.checks.axes import Axes, InMetres, MotionAxes
from imgtransfer.importers.checks.motion import note_motion
from imgtransfer.importers.checks.weld import Welded, weld
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.pipeline.fuse import FuseInputs
from imgtransfer.pipeline.pins import Pins, load_pins
from render import InputError, Option
from render.files.sequence import check_choice, has_scenes, is_cache, is_sequence, load_file

_FILES = {
    "garment": ("template", "initial"),
    "body": ("body",),
    "inner": ("inner",),
}  # whose objects are chosen


def given_files(args: argparse.Namespace) -> FuseInputs:
    """Read --template, --initial, --body, --inner and --pins.

    Raises:
        InputError: files that cannot be read, options that would do nothing for them, or welded seams that part.
    """
    garments = [path for path in (args.template, args.initial, args.inner) if path is not None]
    check_axes_used(
        args,
        body=args.body is not None and is_sequence(args.body),
        garment=any(is_sequence(path) for path in garments),
        wanted="mesh files, those of the body unless it begins with --garment; npz files are in metres, y up",
    )
    if args.weld and args.template is None:
        raise InputError("--weld goes with --template, whose split seams it joins")
    axes, of_garment = chosen_axes(args)
    of_garment = of_garment or axes
    motion = chosen_motion_axes(args)
    arrays = args.body is not None and not is_sequence(args.body)
    moved = args.template if args.initial is not None and is_cache(args.initial) else None
    which = {kind: Option(f"{kind}_object", getattr(args, f"{kind}_object")) for kind in _FILES}
    for kind, files in _FILES.items():
        check_choice(which[kind], *(path for file in files if (path := getattr(args, file)) is not None))
    template = of_garment.of_mesh(load_file(args.template, which["garment"])) if args.template else None
    opened = {
        "initial": _open(args.initial, "garment", of_garment, motion, which["garment"], rest=moved),
        "body": _open(args.body, "body", axes, motion, which["body"]),
        "inner": _open(args.inner, "garment", of_garment, motion, which["inner"]),
    }
    given = FuseInputs(
        template=template,
        clip=clip_reader(args.body) if arrays else None,
        pins=load_pins(args.pins) if args.pins else None,
        **{name: None if one is None else one.sequence for name, one in opened.items()},
    )
    note_motion([one for name in ("body", "initial", "inner") if (one := opened[name]) is not None])
    return _welded(given, args) if args.weld else given


def _open(
    path: Path | None,
    kind: Kind,
    axes: Axes,
    motion: MotionAxes,
    which: Option,
    *,
    rest: Path | None = None,
) -> InMetres | None:
    """A file's mesh in motion; what is chosen counts where the file has several."""
    if path is None:
        return None
    scene = any(has_scenes(file) for file in (path, rest) if file is not None)
    chosen = which if scene else Option(which.name)
    return open_in_metres(path, kind, axes, rest, motion=motion, which=chosen)


def _welded(given: FuseInputs, args: argparse.Namespace) -> FuseInputs:
    """What was given in the numbering of the template's file, in that of its welded vertices."""
    assert given.template is not None
    welded = weld(given.template)
    initial, pins = given.initial, given.pins
    if initial is not None and len(initial.mesh.vertices) == len(given.template.vertices):
        initial = weld_sequence(initial, welded)
    if pins is not None:
        pins = _of_welded(pins, welded, args)
    return replace(given, template=welded.mesh, initial=initial, pins=pins)


def _of_welded(pins: Pins, welded: Welded, args: argparse.Namespace) -> Pins:
    """The pins of the file's vertices, one for each welded vertex."""
    assert welded.mesh.surface is not None
    number = welded.mesh.surface.vertices
    if pins.indices.size and not (pins.indices.min() >= 0 and pins.indices.max() < len(number)):
        raise InputError(f"{args.pins}: there are vertices 0 to {len(number) - 1} in {args.template}")
    indices, first = np.unique(number[pins.indices], return_index=True)
    return Pins(indices, None if pins.positions is None else pins.positions[..., first, :])
