"""A moving mesh from one file a frame, or from a point cache; what does not fit together is named by its file."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.atomic import check_regular
from render.files.mesh_files import load_mesh
from render.files.naming import natural, natural_sort
from render.files.point_caches import SUFFIXES as CACHES
from render.files.point_caches import read_cache
from render.limits import FARTHEST_IN_FILES
from render.mesh.mesh import Mesh, zero_frame

MESHES = (".obj", ".ply", ".glb")


@dataclass(frozen=True, eq=False)
class MovingMesh:
    """A mesh in motion, in its file's units and axes.

    Args:
        vertices: (T, N, 3) float32.
        mesh: the first frame, or the mesh that goes with a point cache; with its surface.
        fps: where the file tells, else None.
    """

    vertices: np.ndarray
    mesh: Mesh
    fps: float | None


def read_moving_mesh(
    source: Path, *, topology: Mesh | None = None, progress: Callable[[int], object] | None = None
) -> MovingMesh:
    """Read a moving mesh.

    Args:
        source: a folder of OBJ, PLY or GLB files, one a frame; a pattern of such files, such as out/shirt_*.obj; or a
            point cache (.pc2, .pc16, .mdd).
        topology: the mesh that a cache moves; not needed for files.
        progress: called with 1 after each file.

    Raises:
        InputError: nothing there, frames missing or of several kinds, vertex counts or triangles that change,
            values not finite, or a cache without its mesh or of another number of vertices.
    """
    if source.suffix.lower() in CACHES:
        return _from_cache(source, topology)
    files = frame_files(source)
    first = load_mesh(files[0])
    connections = _vertices_and_rest(files[0])[1]
    vertices = np.empty((len(files), len(first.vertices), 3), np.float32)
    for frame, file in enumerate(files):
        moved, rest = _vertices_and_rest(file)
        if moved is None or moved.shape != first.vertices.shape or rest != connections:
            mesh = load_mesh(file)
            _check_same(first, mesh, file, frame)
            moved = mesh.vertices
        vertices[frame] = moved
        if progress is not None:
            progress(1)
    return MovingMesh(vertices, first, None)


def _vertices_and_rest(file: Path) -> tuple[np.ndarray | None, str]:
    """The vertices (N, 3) of an OBJ, and the text of all else but normals and comments: the same in most frames.

    Four times as fast as reading the triangles of every frame. Without vertices for what needs the whole reader: other
    formats, and what it will refuse.
    """
    if file.suffix.lower() != ".obj":
        return None, ""
    check_regular(file, "a mesh file")
    lines = file.read_text(errors="replace").splitlines()
    places = [line.split()[1:4] for line in lines if line.startswith("v ")]
    try:
        vertices = np.array(places, np.float64)
    except ValueError:
        return None, ""
    rest = "\n".join(line for line in lines if not line.startswith(("v ", "vn ", "#")))
    return (vertices if (np.abs(vertices) <= FARTHEST_IN_FILES).all() else None), rest


def _from_cache(source: Path, topology: Mesh | None) -> MovingMesh:
    if topology is None:
        raise InputError(
            f"{source}: a point cache has no triangles; give the mesh that it moves (OBJ or PLY) with it"
        )
    cache = read_cache(source)
    if (lost := zero_frame(cache.vertices)) is not None:
        raise InputError(f"{source}: all points of frame {lost} are 0, which is no mesh; export it again")
    if cache.vertices.shape[1] != len(topology.vertices):
        raise InputError(
            f"{source}: {cache.vertices.shape[1]} points a frame, but {topology.source} has "
            f"{len(topology.vertices)} vertices; they must be the same mesh"
        )
    return MovingMesh(cache.vertices, topology, cache.fps)


def _check_same(first: Mesh, mesh: Mesh, file: Path, frame: int) -> None:
    if len(mesh.vertices) != len(first.vertices):
        raise InputError(
            f"{file}: {len(mesh.vertices)} vertices, but the first frame has {len(first.vertices)}; the vertex count "
            "must not change between frames: export without remeshing, decimation or a view-dependent modifier"
        )
    if not np.array_equal(mesh.faces, first.faces):
        raise InputError(
            f"{file}: as many vertices as the first frame, but other triangles (frame {frame}); every frame must be "
            "the same mesh in the same vertex order"
        )


def frame_files(source: Path) -> list[Path]:
    """The files of the frames in their order: by the last number in their names, by its value.

    Raises:
        InputError: no such folder, no mesh files, several kinds of names or endings, or numbers that are missing.
    """
    pattern = any(sign in source.name for sign in "*?[")
    if not pattern and not source.is_dir():
        what = "a folder of OBJ, PLY or GLB frames, a pattern such as FOLDER/shirt_*.obj, or a point cache"
        raise InputError(f"{source}: no such folder; wanted is {what} ({', '.join(CACHES)})")
    found = source.parent.glob(source.name) if pattern else source.iterdir()
    files = natural_sort(
        file for file in found if file.suffix.lower() in MESHES and not file.name.startswith(".")
    )
    if not files:
        raise InputError(f"{source}: no OBJ, PLY or GLB files here; one a frame is wanted")
    names = {re.sub(r"\d+(?=\D*$)", "#", file.name, count=1) for file in files}
    if len(names) > 1:
        some = ", ".join(sorted(names, key=natural)[:3])
        raise InputError(
            f"{source}: files of several kinds ({some}); give a pattern for one of them, such as "
            f"'{(source.parent if pattern else source) / sorted(names)[0].replace('#', '*')}'"
        )
    _check_complete(source, files)
    return files


def _check_complete(source: Path, files: list[Path]) -> None:
    if len(files) == 1:
        return
    matches = [re.search(r"(\d+)(?=\D*$)", file.stem) for file in files]
    if any(match is None for match in matches):
        raise InputError(f"{source}: the files' names have no numbers, so their order is not known")
    numbers = [int(match[1]) for match in matches if match is not None]
    steps = np.diff(numbers)
    if (steps == 0).any():
        twice = int(np.argmax(steps == 0))
        raise InputError(f"{source}: {files[twice].name} and {files[twice + 1].name} are the same frame")
    step = int(steps.min())
    # Numbers may be times of day, a year apart: what is missing is never counted through.
    gaps = (number for a, b in pairwise(numbers) for number in range(a + step, b, step))
    missing = list(islice(gaps, 6))
    if missing or (steps % step).any():
        listed = ", ".join(str(number) for number in missing[:5]) + (" ..." if len(missing) > 5 else "")
        raise InputError(
            f"{source}: frames are missing between {files[0].name} and {files[-1].name}: {listed or 'uneven steps'} "
            f"({len(files)} files found)"
        )
