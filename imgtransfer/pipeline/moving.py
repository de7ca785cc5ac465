"""Surfaces in motion and pinned vertices, from whatever files people have them in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shortened
from typing import Literal

import numpy as np

from imgtransfer.data.clip import REQUIRED, Clip
from imgtransfer.data.clip_checks import plain
from imgtransfer.data.reader import NpzReader, Reader
from imgtransfer.importers.checks.axes import Axes
from render import InputError, load_mesh
from render.files.atomic import check_regular
from render.files.mesh_files import SUFFIXES
from render.files.npz import open_npz
from render.mesh.mesh import check_faces, check_finite

Kind = Literal["body", "garment"]
_DIGITS = 9  # of a vertex number
_MOST = 10**_DIGITS


@dataclass(frozen=True, eq=False)
class Moved:
    """Some frames of a surface: vertices (T, B, 3), metres, world coordinates; and of its clip, where it is of one."""

    vertices: np.ndarray
    clip: Clip | None = None


@dataclass(frozen=True, eq=False)
class Moving:
    """A surface in motion, whose frames are read when their turn comes.

    Args:
        faces: (G, 3) integers.
        n_frames: T.
        parts: all frames in order, so many at a time as it is given; the last part may be shorter.
        still: the first frame of the clip that it is of.
    """

    faces: np.ndarray
    n_frames: int
    parts: Callable[[int], Iterator[Moved]]
    still: Clip | None = None


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices that the fusion must not move.

    Args:
        indices: (P,) int64, counted from 0.
        positions: (P, 3), or (T, P, 3) for other places in each frame; metres, world coordinates. None: they stay
            where they start.
        source: what messages call them.
    """

    indices: np.ndarray
    positions: np.ndarray | None = None
    source: str = "pins"

    def check(self, n_vertices: int) -> None:
        """Raise InputError where a garment of so many vertices lacks one of these."""
        beyond = self.indices[self.indices >= n_vertices]
        if len(beyond):
            raise InputError(
                f"{self.source}: vertex {beyond[0]} is wanted, but the garment has 0..{n_vertices - 1}"
            )

    def over(self, frames: int) -> np.ndarray | None:
        """Positions (T, P, 3).

        Raises:
            InputError: positions of another number of frames.
        """
        if self.positions is None or self.positions.ndim == 3:
            if self.positions is not None and len(self.positions) != frames:
                raise InputError(
                    f"{self.source}: positions of {len(self.positions)} frames, but the maps have {frames}; give as "
                    "many, or (P, 3) for all frames"
                )
            return self.positions
        return np.broadcast_to(self.positions, (frames, *self.positions.shape))


def is_meshes(path: Path) -> bool:
    """Whether `open_moving` would read mesh files, whose coordinates may lie in any way, at a path."""
    return path.is_dir() or path.suffix.lower() in SUFFIXES


def open_moving(path: Path, kind: Kind, axes: Axes | None = None) -> Moving:
    """A body or a garment in motion.

    Args:
        path: a clip npz, or an npz with `<kind>_faces` (G, 3) and `<kind>_vertices` (T, B, 3); or one mesh file for a
            single frame; or a folder of mesh files, a frame each, ordered by name.
        kind: which of a clip's surfaces, and what the arrays are called.
        axes: how mesh files lie; None for metres, y up. Arrays are metres, y up, always.

    Raises:
        InputError: no such file, a damaged one, or arrays that are missing or of a wrong shape. What only the content
            of a later frame shows is raised when that is read.
    """
    if path.is_dir():
        files = sorted(entry for entry in path.iterdir() if entry.suffix.lower() in SUFFIXES)
        if not files:
            raise InputError(f"{path}: no mesh file in it ({', '.join(SUFFIXES)})")
        return _from_meshes(files, axes or Axes())
    if path.suffix.lower() in SUFFIXES:
        return _from_meshes([path], axes or Axes())
    names = (f"{kind}_faces", f"{kind}_vertices")
    wanted = f"an npz with {' and '.join(names)}, or mesh files ({', '.join(SUFFIXES)}),"
    with open_npz(path, wanted) as npz:
        if set(REQUIRED) - {"garment_vertices"} <= set(npz.names):
            return _of_clip(NpzReader(path), path, kind)
        missing = [name for name in names if name not in npz]
        if missing:
            raise InputError(f"{path}: lacks {' and '.join(missing)}; a {kind} in motion needs both")
        shape = npz.shape(names[1])
        if len(shape) != 3 or shape[0] == 0 or shape[2] != 3:
            raise InputError(f"{path}: {names[1]} must have shape (frames, vertices, 3), found {shape}")
        faces = npz.read(names[0])
    check_faces(faces, shape[1], f"{path}: {names[0]}")
    return Moving(plain(faces, whole=True), shape[0], lambda count: _rows(path, names[1], count))


def _rows(path: Path, name: str, count: int) -> Iterator[Moved]:
    with open_npz(path) as npz:
        first = 0
        for vertices in npz.rows(name, count):
            check_finite(vertices, f"{path}: {name}", first=first)
            first += len(vertices)
            yield Moved(plain(vertices, whole=False))


def _of_clip(reader: Reader, path: Path, kind: Kind) -> Moving:
    still = reader.clip(0, 1)
    if kind == "garment" and still.garment is None:
        raise InputError(f"{path}: this clip has no garment_vertices, only a body")

    def parts(count: int) -> Iterator[Moved]:
        for clip in reader.parts(count):
            moving = clip.body if kind == "body" else clip.garment
            assert moving is not None
            yield Moved(moving.vertices, clip)

    faces = still.body.faces if kind == "body" else still.template.faces
    return Moving(faces, reader.n_frames, parts, still)


def load_pins(path: Path) -> Pins:
    """Read which vertices to pin.

    Args:
        path: an npz with `indices` (P,) and, if wanted, `positions` (P, 3) or (T, P, 3); or a text file with vertex
            numbers, separated by blanks, commas, semicolons or lines; # begins a remark. Counted from 0.

    Raises:
        InputError: no such file, or nothing usable in it.
    """
    wanted = "an npz with indices, or a text file of vertex numbers,"
    check_regular(path, wanted)
    if path.suffix.lower() != ".npz":
        return Pins(_numbers(path), source=str(path))
    with open_npz(path, wanted) as npz:
        if "indices" not in npz:
            raise InputError(f"{path}: lacks indices, the numbers of the pinned vertices, counted from 0")
        shape, dtype = npz.shape("indices"), npz.dtype("indices")
        if len(shape) != 1 or dtype.kind not in "iu":
            raise InputError(f"{path}: indices must be whole numbers (P,), found {dtype} {shape}")
        indices, positions = npz.read("indices"), None
        if "positions" in npz:
            placed = npz.shape("positions")
            if len(placed) not in (2, 3) or placed[-2:] != (len(indices), 3):
                raise InputError(
                    f"{path}: positions must have shape ({len(indices)}, 3) or (frames, {len(indices)}, 3), "
                    f"found {placed}"
                )
            positions = npz.read("positions")
            check_finite(positions, f"{path}: positions")
            positions = plain(positions, whole=False)
    wrong = indices[(indices < 0) | (indices >= _MOST)]
    if len(wrong):
        raise InputError(f"{path}: indices are vertex numbers from 0, found {wrong[0]}")
    return Pins(indices.astype(np.int64), positions, str(path))


def _from_meshes(files: Sequence[Path], axes: Axes) -> Moving:
    first = load_mesh(files[0])

    def vertices(file: Path) -> np.ndarray:
        mesh = load_mesh(file)
        if mesh.vertices.shape != first.vertices.shape or not np.array_equal(mesh.faces, first.faces):
            raise InputError(
                f"{mesh.source}: {len(mesh.vertices)} vertices and {len(mesh.faces)} faces; every frame must have "
                f"those of {first.source}, {len(first.vertices)} and {len(first.faces)}, in the same order"
            )
        return axes.apply(mesh.vertices[None])[0].astype(np.float32)

    def parts(count: int) -> Iterator[Moved]:
        for start in range(0, len(files), count):
            yield Moved(np.stack([vertices(file) for file in files[start : start + count]]))

    return Moving(first.faces, len(files), parts)


def _numbers(path: Path) -> np.ndarray:
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from error
    found: list[int] = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#", 1)[0].replace(",", " ").replace(";", " ").split()
        bad = [word for word in words if not (word.isascii() and word.isdecimal() and len(word) <= _DIGITS)]
        if bad:
            raise InputError(
                f"{path}: line {number}: vertex numbers from 0 are wanted, found {shortened(bad[0])}"
            )
        found += [int(word) for word in words]
    if not found:
        raise InputError(f"{path}: no vertex numbers in it")
    return np.array(found, np.int64)
