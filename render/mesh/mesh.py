"""Triangle meshes: checking and topology."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from render.errors import InputError
from render.limits import FARTHEST, FARTHEST_IN_FILES
from render.mesh.file_axes import FileAxes
from render.mesh.surface import Surface


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh whose connectivity is known to be usable.

    Args:
        vertices: (N, 3) float64, metres, y up.
        faces: (F, 3) int64, counter-clockwise seen from outside, every index in [0, N).
        source: what error messages call it, usually the file name.
        surface: texture coordinates, materials and the file's numbering; None where nothing of it is known.
        axes: how the vertices lie where their file says so and they are as they are in it; else None.
        left_out: what its file has beside it, or more than is taken, in words for summaries.

    Raises:
        InputError: no faces, wrong shapes, an index out of range, or a vertex that is not finite or beyond ±10⁹.
    """

    vertices: np.ndarray
    faces: np.ndarray
    source: str = "mesh"
    surface: Surface | None = None
    axes: FileAxes | None = None
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        vertices, faces = np.asarray(self.vertices, np.float64), np.asarray(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise InputError(f"{self.source}: vertices must have shape (N, 3), found {vertices.shape}")
        check_faces(faces, len(vertices), self.source)
        check_finite(vertices, self.source, limit=FARTHEST_IN_FILES, unit="")  # in the file's unit
        object.__setattr__(self, "vertices", np.ascontiguousarray(vertices))
        object.__setattr__(self, "faces", np.ascontiguousarray(faces, np.int64))

    @cached_property
    def edges(self) -> np.ndarray:
        """As `edges_of` the faces."""
        return edges_of(self.faces)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """(E, 2), every undirected edge of faces (F, 3) once, smaller index first, sorted."""
    halves = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(halves, axis=0)


def check_faces(faces: np.ndarray, n_vertices: int, source: str) -> None:
    """Raise InputError unless `faces` is a non-empty (F, 3) integer array of indices in [0, n_vertices)."""
    if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
        raise InputError(
            f"{source}: faces must be integers of shape (F, 3), found {faces.dtype} {faces.shape}"
        )
    if len(faces) == 0:
        raise InputError(f"{source}: the mesh has no faces; a point cloud cannot be imaged")
    if faces.min() >= 0 and faces.max() < n_vertices:
        return
    bad = np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))
    raise InputError(
        f"{source}: face {bad[0]} uses vertices {faces[bad[0]].tolist()}, but only 0..{n_vertices - 1} "
        f"exist ({len(bad)} of {len(faces)} faces are bad; OBJ files count from 1)"
    )


def check_finite(
    vertices: np.ndarray, source: str, *, limit: float = FARTHEST, unit: str = "m", first: int = 0
) -> None:
    """Raise InputError, naming the first vertex, where there is no number within ±`limit`.

    The one check before vertices are used or written: NaN, infinity, and what is no place of a garment or body.

    Args:
        vertices: (N, 3), or (T, N, ...) of T frames: the message then names the frame, too.
        source: what the message calls them.
        limit, unit: for other numbers than positions in metres.
        first: number of the first of the T frames, for the message.
    """
    if vertices.dtype.kind not in "fiu":
        raise InputError(f"{source}: numbers are wanted, found {vertices.dtype}")
    if not vertices.size or (vertices.min() >= -limit and vertices.max() <= limit):  # NaN is neither
        return
    bad = np.argwhere(~((vertices >= -limit) & (vertices <= limit)).all(axis=-1))
    where = f"vertex {bad[0][0]}" if vertices.ndim == 2 else f"frame {first + bad[0][0]}, vertex {bad[0][1]}"
    value = vertices[tuple(bad[0])]
    wrong = f"beyond ±{limit:g} {unit}".rstrip() if np.isfinite(value).all() else "not finite"
    raise InputError(f"{source}: {where} is {value.tolist()}, {wrong} ({len(bad)} such vertices)")


def zero_frame(frames: np.ndarray) -> int | None:
    """The first of the frames (T, ...) in which all is 0, counted from 0; None where there is none."""
    values = frames.reshape(len(frames), math.prod(frames.shape[1:]))
    lost = next(
        (frame for frame in np.flatnonzero(~values[:, :1].any(axis=1)) if not values[frame].any()), None
    )
    return None if lost is None else int(lost)
