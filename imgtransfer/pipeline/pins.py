"""Pinned vertices, from whatever files people have them in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shortened

import numpy as np

from imgtransfer.data.clip_checks import plain
from render import InputError
from render.files.atomic import check_regular
from render.files.npz import open_npz
from render.mesh.mesh import check_finite

_DIGITS = 9  # of a vertex number
_MOST = 10**_DIGITS


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


def _numbers(path: Path) -> np.ndarray:
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from error
    numbers: list[int] = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#", 1)[0].replace(",", " ").replace(";", " ").split()
        bad = [word for word in words if not (word.isascii() and word.isdecimal() and len(word) <= _DIGITS)]
        if bad:
            raise InputError(
                f"{path}: line {number}: vertex numbers from 0 are wanted, found {shortened(bad[0])}"
            )
        numbers += [int(word) for word in words]
    if not numbers:
        raise InputError(f"{path}: no vertex numbers in it")
    return np.array(numbers, np.int64)
