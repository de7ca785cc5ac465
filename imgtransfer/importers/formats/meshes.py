"""Anyone's meshes: a moving garment on a moving body, from files a frame, point caches, or Alembic or USD files.

A clip's folder holds `garment` and `body`, each as a folder of OBJ or PLY frames, as frames beside each other
(`garment_0000.obj`, `body_0000.obj`; what `imgtransfer export` writes), as a point cache (`garment.pc2`,
`.mdd`, `.pc16`), or as an Alembic or USD file (`garment.abc`, `.usd`). In it, or in the folder above, are
`template` and `body_rest`: both in the body's rest pose. Without them the first frame is the rest pose. One
Alembic or USD file with both meshes is a clip, too.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.axes import InMetres
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.meshes import check_template
from imgtransfer.importers.checks.motion import check_motion
from imgtransfer.importers.checks.weld import weld
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.mesh_files import Source, find_source, moving_in
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.importers.summary import (
    Summary,
    lying_facts,
    mesh_text,
    motion_text,
    rate_text,
    size_text,
)
from imgtransfer.importers.together import together
from render import InputError, Option
from render.files.naming import natural_sort
from render.files.scenes.reader import is_scene

_log = logging.getLogger(__name__)

FPS = 30.0


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a clip's folder in `paths`; a folder of such folders will do.

    Each is checked before any is read whole; what is odd but no obstacle is printed.

    Raises:
        InputError: what `find_source` and `imgtransfer.importers.checks.meshes` refuse; no split given.
    """
    folders = []
    for path in paths:
        entries = natural_sort(path.iterdir()) if path.is_dir() else []
        inner = [entry for entry in entries if entry.is_dir() and not entry.name.startswith(".")]
        several = any(moving_in(entry, "body") for entry in inner) and moving_in(path, "body") is None
        folders += inner if several else [path]
    return [job_of(_clip_name(folder), find_source(folder, options), options) for folder in folders]


def _clip_name(source: Path) -> str:
    return source.stem if is_scene(source) else source.resolve().name


def job_of(name: str, source: Source, options: ImportOptions) -> Job:
    """The job for one clip, after its first frame and its rest pose have been checked.

    Args:
        name: of the clip; the garment is `options.garment`, or "garment".

    Raises:
        InputError: no split, bad files, or what the checks found.
    """
    if not options.split:
        raise InputError(f"import meshes: each clip needs a split: add {Option('split')} train or test")
    files = source.files()
    garment, body = _prepare(source, options, check=True)
    clip = valid_clip_name(options.garment or "garment", name)
    summary = _summary(clip, garment, body, options)
    return Job(clip, options.split, files, lambda: _clip(source, options), summary)


def _summary(name: str, taken: InMetres, worn_by: InMetres, options: ImportOptions) -> Summary:
    """What is taken for a clip, once it is checked."""
    garment, body = taken.sequence, worn_by.sequence
    joined = weld(garment.mesh).joined if options.weld else None
    if garment.fps and body.fps and garment.fps != body.fps:  # and one has no times
        _log.warning(
            "note: %s has %g frames a second, %s %g", garment.source, garment.fps, body.source, body.fps
        )
    facts = [
        ("garment", motion_text(garment)),
        ("", f"{mesh_text(garment.mesh, joined)}; {size_text(garment.mesh)}"),
        ("body", motion_text(body)),
        ("", f"{len(body.mesh.vertices)} vertices; {size_text(body.mesh)}"),
        *lying_facts(body.mesh, worn_by.axes, {"garment": taken.axes, "frames": worn_by.frames}),
        ("rate", rate_text(options.fps, garment.fps or body.fps, FPS)),
    ]
    return Summary(name, tuple(facts))


def _prepare(source: Source, options: ImportOptions, *, check: bool) -> tuple[InMetres, InMetres]:
    """Garment and body with their rest pose and first frames; `check` them, and print what does not stop the work."""
    garment_axes = options.garment_axes or options.axes
    motion = options.motion_axes
    chosen = Option("garment_object", options.garment_object), Option("body_object", options.body_object)
    garment = open_in_metres(
        source.garment, "garment", garment_axes, source.template, motion=motion, which=chosen[0]
    )
    body = open_in_metres(source.body, "body", options.axes, source.body_rest, motion=motion, which=chosen[1])
    both = together(garment.sequence, body.sequence)
    garment, body = replace(garment, sequence=both[0]), replace(body, sequence=both[1])
    if check:
        if both[2]:
            _log.warning("note: %s", both[2])
        found = check_template(
            garment.sequence.mesh,
            body.sequence.mesh,
            given=body.axes,
            garment_given=garment.axes,
            welding=options.weld,
        )
        if not {"unit", "axes"} & {fault.kind for fault in found}:
            found += check_motion([body, garment])
        for text in refuse(found, anyway=options.anyway):
            _log.warning("note: %s", text)
    return garment, body


def _clip(source: Source, options: ImportOptions) -> Clip:
    garment, body = (opened.sequence for opened in _prepare(source, options, check=False))
    if options.weld:
        garment, body = weld_sequence(garment), weld_sequence(body)
    total = garment.n_frames + body.n_frames
    with tqdm(total=total, desc=source.garment.parent.name, unit="frame", leave=False, disable=None) as bar:
        garment, body = (sequence.loaded(bar.update) for sequence in (garment, body))
    clip = Clip(
        template=Template(vertices=garment.mesh.vertices.astype(np.float32), faces=garment.mesh.faces),
        garment=Garment(garment.vertices()),
        body=Body(
            rest=body.mesh.vertices.astype(np.float32), faces=body.mesh.faces, vertices=body.vertices()
        ),
        fps=float(options.fps or garment.fps or body.fps or FPS),
        info={"source": str(source.garment), "units": "m"},
        name=source.garment.stem,
    ).with_surface(garment.mesh.surface)
    if not options.anyway:
        check_worn(
            clip,
            str(source.garment),
            hint=f"do garment and body begin at the same frame? ({Option('anyway', True)} goes on)",
        )
    return clip
