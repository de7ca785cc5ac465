"""Meshes in motion as every command takes them: from any files, in metres, y up, at rest if a rest pose is known."""

from __future__ import annotations

import os
from pathlib import Path

from imgtransfer.data.sequences import Kind, open_clip_arrays
from imgtransfer.importers.checks.axes import AS_AT_REST, Axes, InMetres, MotionAxes
from imgtransfer.importers.checks.weld import Welded, weld, weld_motion
from render import InputError, MeshSequence, Option
from render.files.atomic import check_regular
from render.files.mesh_files import SUFFIXES as MESHES
from render.files.scenes.reader import SUFFIXES as SCENES
from render.files.sequence import check_choice, is_cache, is_sequence, load_file, open_sequence

REST = {"garment": "template", "body": "body_rest"}  # what files of the rest pose are called


def open_in_metres(
    path: Path,
    kind: Kind,
    axes: Axes,
    rest: Path | None = None,
    *,
    motion: MotionAxes = AS_AT_REST,
    which: Option | None = None,
) -> InMetres:
    """A garment or a body in motion; frames are read when their turn comes.

    Args:
        path: a folder of mesh files, a pattern, one mesh file, a point cache, or an Alembic or USD file; or a clip npz,
            or an npz with `<kind>_faces` and `<kind>_vertices`. A cache without `rest` moves the mesh beside it.
        kind: which of a clip's meshes, and what arrays and files are called.
        axes: how mesh files lie; arrays are in metres, y up, always.
        rest: a mesh file with the rest pose; None takes the first frame, or what a cache moves.
        motion: how the frames lie where they lie otherwise than the rest pose.
        which: the option that chooses among the meshes of Alembic and USD files; None is `<kind>_object` without value.

    Raises:
        InputError: files that cannot be read, a cache without the mesh that it moves, or a rest pose that is not the
            frames' mesh.
    """
    which = which or Option(f"{kind}_object")
    check_choice(which, *(file for file in (path, rest) if file is not None))
    resting = load_file(rest, which) if rest is not None else None
    if is_sequence(path) or not (path.suffix.lower() == ".npz" or path.is_file()):
        if resting is None and is_cache(path):
            beside = mesh_beside(path, kind)
            if beside is None:
                raise InputError(
                    f"{path}: a point cache has no triangles; put the mesh that it moves beside it as {REST[kind]}.obj"
                )
            resting = load_file(beside, which)
        opened = open_sequence(path, resting, which)
        frames = motion.beside(axes).of_file(opened.mesh.axes)
        sequence = frames.of_sequence(opened)
    else:
        frames, sequence = None, open_clip_arrays(path, kind)
    if resting is None:
        return InMetres(sequence, frames or Axes(), frames)
    axes = axes.of_file(resting.axes)
    return InMetres(sequence.at_rest(axes.of_mesh(resting), kind), axes, frames)


def weld_sequence(sequence: MeshSequence, welded: Welded | None = None) -> MeshSequence:
    """The sequence with its split seams joined.

    Args:
        welded: the seams; None finds them in the sequence's mesh.

    Raises:
        InputError: when frames are read: joined vertices part, so that they are no seam.
    """
    seams = welded or weld(sequence.mesh)
    return sequence.mapped(
        lambda vertices, first: weld_motion(vertices, seams, source=sequence.source, first=first), seams.mesh
    )


def mesh_file(folder: Path, name: str) -> Path | None:
    """A mesh file of this name in the folder, or in the one above.

    Raises:
        InputError: it is there, but no regular file.
    """
    suffixes = (*MESHES, *SCENES)
    places = [place / f"{name}{suffix}" for place in (folder, folder.resolve().parent) for suffix in suffixes]
    return next((place for place in places if is_there(place, "a mesh file")), None)


def is_there(path: Path, wanted: str) -> bool:
    """Whether there is such a file; InputError for anything else of that name, which nobody would be told of."""
    if not os.path.lexists(path):
        return False
    check_regular(path, wanted)
    return True


def mesh_beside(path: Path, kind: Kind) -> Path | None:
    """The mesh that a point cache moves: a file beside it of its name, or called as the rest pose is.

    None where there is none, and for what is no cache.
    """
    if not is_cache(path):
        return None
    named = [path.with_suffix(suffix) for suffix in MESHES]
    own = next((place for place in named if is_there(place, "a mesh file")), None)
    return own or mesh_file(path.parent, REST[kind])
