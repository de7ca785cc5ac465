"""Anyone's meshes: a moving garment on a moving body, from files a frame or point caches.

A clip's folder holds `garment` and `body`, each as a folder of OBJ or PLY frames, as frames beside each other
(`garment_0000.obj`, `body_0000.obj`; what `imgtransfer export` writes), or as a point cache (`garment.pc2`,
`.mdd`, `.pc16`). In it, or in the folder above, are `template` and `body_rest` (OBJ, PLY, GLB or STL): both in
the body's rest pose. Without them the first frame is the rest pose.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.meshes import check_template
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.mesh_files import Source, check_frames, find_source, moving_in
from imgtransfer.importers.part import Part
from render import InputError, Option
from render.files.naming import natural_sort

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
        several = moving_in(path, "body") is None and any(moving_in(entry, "body") for entry in inner)
        folders += inner if several else [path]
    return [job_of(folder.resolve().name, find_source(folder, options), options) for folder in folders]


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
    _prepare(source, options, check=True)
    return Job(
        valid_clip_name(options.garment or "garment", name),
        options.split,
        files,
        lambda: _clip(source, options),
    )


def _prepare(source: Source, options: ImportOptions, *, check: bool) -> tuple[Part, Part]:
    """Garment and body with their rest pose and first frames; `check` them, and print what does not stop the work."""
    garment_axes = options.garment_axes or options.axes
    garment = Part.open("garment", source.garment, source.template, garment_axes)
    body = Part.open("body", source.body, source.body_rest, options.axes)
    check_frames(source)
    if check:
        found = check_template(
            garment.rest,
            body.rest,
            given=options.axes,
            garment_given=garment_axes,
            welding=options.weld,
        )
        for text in refuse(found, anyway=options.anyway):
            _log.warning("note: %s", text)
    return garment, body


def _clip(source: Source, options: ImportOptions) -> Clip:
    parts = _prepare(source, options, check=False)
    with tqdm(
        total=len(source.files()), desc=source.garment.parent.name, unit="file", leave=False, disable=None
    ) as bar:
        garment, body = (part.read(welding=options.weld, progress=bar.update) for part in parts)
    if len(garment.vertices) != len(body.vertices):
        raise InputError(
            f"{source.garment}: {len(garment.vertices)} frames, but {source.body} has {len(body.vertices)}; both must "
            "have the same frames"
        )
    clip = Clip(
        template=Template(vertices=garment.rest.vertices.astype(np.float32), faces=garment.rest.faces),
        garment=Garment(garment.vertices),
        body=Body(rest=body.rest.vertices.astype(np.float32), faces=body.rest.faces, vertices=body.vertices),
        fps=float(options.fps or garment.fps or body.fps or FPS),
        info={"source": str(source.garment), "units": "m"},
        name=source.garment.stem,
    ).with_surface(garment.rest.surface)
    if not options.anyway:
        check_worn(
            clip,
            str(source.garment),
            hint=f"do garment and body begin at the same frame? ({Option('anyway', True)} goes on)",
        )
    return clip
