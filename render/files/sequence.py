"""Meshes in motion from files: one file a frame, a point cache, a scene, or arrays; read when their turn comes.

What does not fit together is named by its file. Vertices stay in the file's units and axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.atomic import check_regular
from render.files.frame_files import frame_files, is_pattern
from render.files.mesh_files import SUFFIXES as MESHES
from render.files.mesh_files import load_mesh
from render.files.npz import open_npz
from render.files.obj_frames import vertices_and_rest
from render.files.point_caches import SUFFIXES as CACHES
from render.files.point_caches import open_cache
from render.files.scenes.reader import SUFFIXES as SCENES
from render.files.scenes.reader import is_scene, open_scene
from render.mesh.mesh import Mesh, check_faces, check_finite, zero_frame
from render.mesh.sequence import MeshSequence
from render.options import Option

ONLY = Option("which")  # no mesh of a scene is chosen: there must be one


def is_cache(path: Path) -> bool:
    """Whether a path is read as a point cache."""
    return path.suffix.lower() in CACHES and not path.is_dir() and not is_pattern(path)


def is_sequence(path: Path) -> bool:
    """Whether `open_sequence` would read what is at a path."""
    return path.is_dir() or is_pattern(path) or path.suffix.lower() in (*MESHES, *CACHES, *SCENES)


def sequence_files(source: Path) -> list[Path]:
    """Every file that a sequence is read from, in the order of its frames; what is one file stands for itself.

    Raises:
        InputError: as `frame_files`.
    """
    return frame_files(source) if source.is_dir() or is_pattern(source) else [source]


def open_sequence(source: Path, mesh: Mesh | None = None, which: Option = ONLY) -> MeshSequence:
    """A mesh in motion; its first frame is read, and with it what the mesh is.

    Args:
        source: a folder of OBJ, PLY, GLB, Alembic or USD files, one a frame; a pattern of such files, such as
            out/shirt_*.obj; one mesh file for a single frame; a point cache (.pc2, .pc16, .mdd); or an Alembic or USD
            file of all frames.
        mesh: that a cache moves; not needed for files.
        which: the option, with its value, that chooses among the meshes of an Alembic or USD file.

    Raises:
        InputError: nothing there, frames missing or of several kinds, or a cache without its mesh or of another number
            of vertices. When frames are read: vertex counts or triangles that change, or values not finite.
    """
    if is_scene(source) and not is_pattern(source):
        return open_scene(source, which)
    if is_cache(source):
        return _of_cache(source, mesh)
    files = frame_files(source)
    alone = len(files) == 1 and is_scene(files[0])
    return open_scene(files[0], which) if alone else _of_files(source, files, which)


def load_file(path: Path, which: Option) -> Mesh:
    """The mesh of any file that holds one, in the file's units and axes; of a moving one, the first frame.

    Raises:
        InputError: as `load_mesh` and `open_scene`.
    """
    return open_scene(path, which).mesh if is_scene(path) else load_mesh(path)


def check_choice(which: Option, *files: Path) -> None:
    """Raise InputError where a mesh is chosen, but none of the files has names to choose by."""
    if which.value is not None and not any(map(has_scenes, files)):
        names = ", ".join(map(str, files))
        raise InputError(f"{names}: {which} does nothing here: it chooses a mesh of an Alembic or USD file")


def has_scenes(source: Path) -> bool:
    """Whether what `open_sequence` reads at a path are Alembic or USD files.

    Raises:
        InputError: as `frame_files`.
    """
    return any(map(is_scene, sequence_files(source)))


def open_arrays(path: Path, faces: str, vertices: str) -> MeshSequence:
    """A mesh in motion from an npz.

    Args:
        path: the file. faces, vertices: names of its arrays (F, 3) and (T, N, 3).

    Raises:
        InputError: no such file, a damaged one, or arrays that are missing or of a wrong shape. When frames are read:
            values not finite.
    """
    with open_npz(path, f"an npz with {faces} and {vertices}") as npz:
        missing = [name for name in (faces, vertices) if name not in npz]
        if missing:
            raise InputError(f"{path}: lacks {' and '.join(missing)}; a mesh in motion needs both")
        shape = npz.shape(vertices)
        if len(shape) != 3 or shape[0] == 0 or shape[2] != 3:
            raise InputError(f"{path}: {vertices} must have shape (frames, vertices, 3), found {shape}")
        triangles = npz.read(faces)
        check_faces(triangles, shape[1], f"{path}: {faces}")
        first = next(npz.rows(vertices, 1))[0]
        check_finite(first[None], f"{path}: {vertices}")

    def parts(count: int) -> Iterator[np.ndarray]:
        with open_npz(path) as npz:
            done = 0
            for part in npz.rows(vertices, count):
                check_finite(part, f"{path}: {vertices}", first=done)
                done += len(part)
                double = part.dtype.newbyteorder("=") == np.float64
                yield part.astype(np.float64 if double else np.float32, copy=False)

    return MeshSequence(Mesh(first, triangles, str(path)), shape[0], parts, str(path))


def _of_files(source: Path, files: list[Path], which: Option) -> MeshSequence:
    first = _load_frame(files[0], which)

    def parts(count: int) -> Iterator[np.ndarray]:
        connections = vertices_and_rest(files[0])[1] if files[0].suffix.lower() == ".obj" else None
        for start in range(0, len(files), count):
            vertices = np.empty((min(count, len(files) - start), *first.vertices.shape), np.float32)
            for row, file in enumerate(files[start : start + count]):
                vertices[row] = _frame(file, first, which, connections)
            yield vertices

    def read_frames(numbers: Sequence[int]) -> np.ndarray:
        return np.stack(
            [_frame(files[number], first, which) if number else first.vertices for number in numbers]
        )

    names = [file.name for file in files]
    return MeshSequence(first, len(files), parts, str(source), frame_names=names, read_frames=read_frames)


def _load_frame(file: Path, which: Option) -> Mesh:
    """The mesh of a file that is one frame."""
    if not is_scene(file):
        return load_mesh(file)
    opened = open_scene(file, which)
    if opened.n_frames > 1:
        raise InputError(
            f"{file}: {opened.n_frames} frames in a file of several; give one file with all, or a file a frame"
        )
    return opened.mesh


def _frame(file: Path, first: Mesh, which: Option, connections: bytes | None = None) -> np.ndarray:
    """(N, 3) vertices of a file that is known, or found, to be of the first one's mesh.

    Args:
        connections: the text of the first one but for its vertices, where it is an OBJ: the same text needs no reading.
    """
    if connections is not None:
        check_regular(file, "a mesh file")
        moved, rest = vertices_and_rest(file)
        if moved is not None and moved.shape == first.vertices.shape and rest == connections:
            return moved
    mesh = _load_frame(file, which)
    if mesh.axes != first.axes:
        raise InputError(
            f"{file}: another unit or axis upwards than in {first.source}; export all frames alike"
        )
    if len(mesh.vertices) != len(first.vertices):
        raise InputError(
            f"{file}: {len(mesh.vertices)} vertices, but the first frame has {len(first.vertices)}; the vertex count "
            "must not change between frames: export without remeshing, decimation or a view-dependent modifier"
        )
    if not np.array_equal(mesh.faces, first.faces):
        raise InputError(
            f"{file}: as many vertices as the first frame, but other triangles; every frame must be the same mesh in "
            "the same vertex order"
        )
    return mesh.vertices


def _of_cache(source: Path, mesh: Mesh | None) -> MeshSequence:
    if mesh is None:
        raise InputError(
            f"{source}: a point cache has no triangles; give the mesh that it moves (OBJ or PLY) with it"
        )
    cache = open_cache(source)
    if cache.n_points != len(mesh.vertices):
        raise InputError(
            f"{source}: {cache.n_points} points a frame, but {mesh.source} has {len(mesh.vertices)} vertices; they "
            "must be the same mesh"
        )

    def parts(count: int, start: int = 0) -> Iterator[np.ndarray]:
        done = start
        for part in cache.parts(count, start=start):
            if (lost := zero_frame(part)) is not None:
                raise InputError(
                    f"{source}: all points of frame {done + lost} are 0, which is no mesh; export it again"
                )
            done += len(part)
            yield part

    def read_frames(numbers: Sequence[int]) -> np.ndarray:
        return np.concatenate([next(parts(1, number)) for number in numbers])

    return MeshSequence(mesh, cache.n_frames, parts, str(source), cache.fps, read_frames=read_frames)
