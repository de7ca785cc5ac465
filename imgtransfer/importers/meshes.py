"""Anyone's meshes: a moving garment on a moving body, from files a frame or point caches.

A clip's folder holds `garment` and `body`, each as a folder of OBJ or PLY frames, as frames beside each other
(`garment_0000.obj`, `body_0000.obj`; what `imgtransfer export` writes), or as a point cache (`garment.pc2`,
`.mdd`, `.pc16`). In it, or in the folder above, are `template` and `body_rest` (OBJ, PLY, GLB or STL): both in
the body's rest pose. Without them the first frame is the rest pose.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.clip import Clip
from imgtransfer.importers.axes import Axes
from imgtransfer.importers.caches import SUFFIXES as CACHES
from imgtransfer.importers.check import check_template
from imgtransfer.importers.files import natural_sort
from imgtransfer.importers.findings import refuse
from imgtransfer.importers.frames import MovingMesh, frame_files, read_moving_mesh
from imgtransfer.importers.job import Job, Options, clip_name
from imgtransfer.importers.mesh_files import Source, check_frames, find_source, moving_in
from imgtransfer.importers.weld import weld, weld_motion
from imgtransfer.importers.worn import check_worn
from render import InputError, Mesh, load_mesh
from render.mesh import check_finite

FPS = 30.0


def jobs(paths: list[Path], options: Options) -> list[Job]:
    """One job a clip's folder in `paths`; a folder of such folders will do.

    Each is checked before any is read whole; what is odd but no obstacle is printed.

    Raises:
        InputError: what `find_source` and `imgtransfer.importers.check` refuse; no split given.
    """
    folders = []
    for path in paths:
        entries = natural_sort(path.iterdir()) if path.is_dir() else []
        inner = [entry for entry in entries if entry.is_dir() and not entry.name.startswith(".")]
        several = moving_in(path, "body") is None and any(moving_in(entry, "body") for entry in inner)
        folders += inner if several else [path]
    return [job_of(folder.resolve().name, find_source(folder, options), options) for folder in folders]


def job_of(name: str, source: Source, options: Options) -> Job:
    """The job for one clip, after its first frame and its rest pose have been checked.

    Args:
        name: of the clip; the garment is `options.garment`, or "garment".

    Raises:
        InputError: no split, bad files, or what the checks found.
    """
    if not options.split:
        raise InputError("import meshes: each clip needs a split: add --split train or test")
    files = source.files()
    _prepare(source, options, check=True)
    return Job(
        clip_name(options.garment or "garment", name), options.split, files, lambda: _clip(source, options)
    )


@dataclass(frozen=True, eq=False)
class _Ready:
    """What is known before the frames are read: meshes in the files' units for reading, in ours for the clip."""

    garment: Mesh
    body: Mesh
    template: Mesh
    body_rest: Mesh
    garment_axes: Axes


def _prepare(source: Source, options: Options, *, check: bool) -> _Ready:
    """Read the rest pose and the first frames; `check` them, and print what does not stop the work."""
    garment_axes = options.garment_axes or options.axes
    garment, body = _first(source.garment, source.template), _first(source.body, source.body_rest)
    template = load_mesh(source.template) if source.template else garment
    body_rest = load_mesh(source.body_rest) if source.body_rest else body
    for first, rest, what in ((garment, template, "garment"), (body, body_rest, "body")):
        if len(first.vertices) != len(rest.vertices) or not np.array_equal(first.faces, rest.faces):
            raise InputError(
                f"{first.source}: {len(first.vertices)} vertices, {len(first.faces)} triangles, but {rest.source} has "
                f"{len(rest.vertices)} and {len(rest.faces)}, or others; the rest pose must be the {what}'s own mesh"
            )
    check_frames(source)
    ready = _Ready(
        garment,
        body,
        garment_axes.of_mesh(template),
        options.axes.of_mesh(body_rest),
        garment_axes,
    )
    if check:
        found = check_template(
            ready.template,
            ready.body_rest,
            given=options.axes,
            garment_given=garment_axes,
            welding=options.weld,
        )
        for text in refuse(found, anyway=options.anyway):
            print(f"note: {text}", file=sys.stderr)
    return ready


def _first(moving: Path, rest: Path | None) -> Mesh:
    if moving.suffix.lower() not in CACHES:
        return load_mesh(frame_files(moving)[0])
    if rest is None:
        what = "template" if moving.stem.startswith("garment") else "body_rest"
        raise InputError(
            f"{moving}: a point cache has no triangles; put the mesh that it moves beside it as {what}.obj"
        )
    return load_mesh(rest)


def _clip(source: Source, options: Options) -> Clip:
    ready = _prepare(source, options, check=False)
    with tqdm(
        total=len(source.files()), desc=source.garment.parent.name, unit="file", leave=False, disable=None
    ) as bar:
        garment = read_moving_mesh(source.garment, topology=ready.garment, progress=bar.update)
        body = read_moving_mesh(source.body, topology=ready.body, progress=bar.update)
    if len(garment.vertices) != len(body.vertices):
        raise InputError(
            f"{source.garment}: {len(garment.vertices)} frames, but {source.body} has {len(body.vertices)}; both must "
            "have the same frames"
        )
    moved, body_moved = ready.garment_axes.apply(garment.vertices), options.axes.apply(body.vertices)
    for vertices, what in ((moved, garment.source), (body_moved, body.source)):
        check_finite(vertices, str(what))
    template, body_rest = ready.template, ready.body_rest
    if options.weld:
        welded, welded_body = weld(template), weld(body_rest)
        moved = weld_motion(moved, welded, source=str(source.garment))
        body_moved = weld_motion(body_moved, welded_body, source=str(source.body))
        template, body_rest = welded.mesh, welded_body.mesh
    clip = Clip(
        template_vertices=template.vertices.astype(np.float32),
        garment_faces=template.faces,
        garment_vertices=moved,
        body_rest=body_rest.vertices.astype(np.float32),
        body_faces=body_rest.faces,
        body_vertices=body_moved,
        fps=_fps(garment, body, options),
        info={"source": str(source.garment), "units": "m"},
        name=source.garment.stem,
    ).with_surface(template.surface)
    if not options.anyway:
        check_worn(
            clip, str(source.garment), hint="do garment and body begin at the same frame? (--anyway goes on)"
        )
    return clip


def _fps(garment: MovingMesh, body: MovingMesh, options: Options) -> float:
    told = options.fps or garment.fps or body.fps
    return float(told or FPS)
