"""Point caches: one file with the vertices of every frame.

PC2 (3ds Max): 32 bytes of header, little-endian: "POINTCACHE2\\0", int32 version 1, int32 points, float32 first frame,
float32 frames a sample, int32 samples; then samples × points × 3 float32. As Blender reads it, in
`source/blender/modifiers/intern/MOD_meshcache_pc2.c`.
PC16 is the same header with 16-bit floats: CLOTH3D's own, described in its starter kit and in `IO.py` of
github.com/hbertiche/DeePSD by the same author.
MDD (LightWave): big-endian int32 frames, int32 points, a float32 time in seconds a frame, then the same order of
float32; http://rodolphe-vaillant.fr/?e=134 has the description of its maker.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from render.errors import InputError
from render.files.data_file import check_data_file
from render.files.npz import check_room
from render.limits import FARTHEST_IN_FILES
from render.mesh.mesh import check_finite

SUFFIXES = (".pc2", ".pc16", ".mdd")
_PC2_HEADER = np.dtype(
    [
        ("sign", "S12"),
        ("version", "<i4"),
        ("points", "<i4"),
        ("start", "<f4"),
        ("rate", "<f4"),
        ("samples", "<i4"),
    ]
)


@dataclass(frozen=True)
class PointCache:
    """A cache of which only the header was read; make one with `open_cache`.

    Args:
        path: the file.
        n_frames, n_points: what it holds.
        fps: frames a second, where the file has times, else None.
    """

    path: Path
    n_frames: int
    n_points: int
    fps: float | None
    _number: np.dtype[Any]
    _start: int

    def parts(self, count: int, *, start: int = 0) -> Iterator[np.ndarray]:
        """Frames from number `start` on in order, `count` at a time: (t, N, 3) float32, in the file's units and axes.

        Raises:
            InputError: values not finite, a file that has become shorter, or more than the memory that is free.
        """
        a_frame = self.n_points * 3 * self._number.itemsize
        check_room(2 * a_frame * min(count, self.n_frames), f"{self.path}: {self.n_frames} frames")
        with self.path.open("rb") as file:
            file.seek(self._start + start * a_frame)
            for first in range(start, self.n_frames, count):
                frames = min(count, self.n_frames - first)
                values = np.empty((frames, self.n_points, 3), self._number)
                if file.readinto(values.data.cast("B")) < frames * a_frame:
                    raise InputError(f"{self.path}: truncated while it was read; is it being written?")
                vertices = values.astype(np.float32, copy=False)
                # in the file's unit
                check_finite(vertices, str(self.path), limit=FARTHEST_IN_FILES, unit="", first=first)
                yield vertices

    def vertices(self) -> np.ndarray:
        """All frames, (T, N, 3) float32.

        Raises:
            InputError: as `parts`.
        """
        return next(self.parts(self.n_frames))


def open_cache(path: Path) -> PointCache:
    """Read the header of a .pc2, .pc16 or .mdd file.

    Raises:
        InputError: no such file, another format, a truncated or overlong one, or no frames.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a point cache must be one of {', '.join(SUFFIXES)}, found '{suffix}'")
    check_data_file(path, f"a point cache ({suffix})", whole=False)
    size = path.stat().st_size
    with path.open("rb") as file:
        if suffix == ".mdd":
            return _open_mdd(path, file, size)
        return _open_pc2(path, file, size, half=suffix == ".pc16")


def pc2_header(points: int, samples: int, *, rate: float = 1.0) -> bytes:
    """The header of a PC2 file; `rate` is the frames from one sample to the next."""
    return np.array([(b"POINTCACHE2", 1, points, 0.0, rate, samples)], _PC2_HEADER).tobytes()


def mdd_header(points: int, times: np.ndarray) -> bytes:
    """The header of an MDD file with a frame at each of `times` (T,), in seconds."""
    return np.array([len(times), points], ">i4").tobytes() + times.astype(">f4").tobytes()


def _open_pc2(path: Path, file: IO[bytes], size: int, *, half: bool) -> PointCache:
    start = _PC2_HEADER.itemsize
    content = file.read(start)
    if len(content) < start or not content.startswith(b"POINTCACHE2"):
        raise InputError(f"{path}: not a point cache; its first bytes must be POINTCACHE2")
    header = np.frombuffer(content, _PC2_HEADER, 1)[0]
    number = np.dtype("<f2" if half else "<f4")
    other = np.dtype("<f4" if half else "<f2")
    points, samples = int(header["points"]), int(header["samples"])
    if points > 0 and samples > 0 and size - start == points * samples * 3 * other.itemsize:
        wrong = "PC2 with 32-bit" if half else "PC16 with 16-bit"
        raise InputError(
            f"{path}: mislabelled, it holds {wrong} floats; rename it to {'.pc2' if half else '.pc16'}"
        )
    _check_size(path, size - start, samples, points, number)
    return PointCache(path, samples, points, None, number, start)


def _open_mdd(path: Path, file: IO[bytes], size: int) -> PointCache:
    content = file.read(8)
    if len(content) < 8:
        raise InputError(f"{path}: truncated, an MDD file begins with two numbers")
    frames, points = (int(value) for value in np.frombuffer(content, ">i4", 2))
    start = 8 + 4 * frames
    if frames < 1 or points < 1 or size < start:
        raise InputError(f"{path}: not an MDD point cache; it would have {frames} frames of {points} points")
    number = np.dtype(">f4")
    _check_size(path, size - start, frames, points, number)
    times = np.frombuffer(file.read(4 * frames), ">f4", frames).astype(np.float64)
    if not np.isfinite(times).all():
        raise InputError(f"{path}: the frames' times are not finite; the file is damaged")
    seconds = times[-1] - times[0]
    steady = frames > 1 and seconds > 0 and np.allclose(np.diff(times), seconds / (frames - 1), rtol=0.01)
    fps = round((frames - 1) / seconds, 3) if steady else None
    return PointCache(path, frames, points, fps, number, start)


def _check_size(path: Path, size: int, frames: int, points: int, number: np.dtype[Any]) -> None:
    """Raise InputError unless the bytes behind the header are those of so many frames and points."""
    if frames < 1 or points < 1:
        raise InputError(f"{path}: the cache says that it has {frames} frames of {points} points")
    a_frame = points * 3 * number.itemsize
    if size != frames * a_frame:
        wrong = "truncated" if size < frames * a_frame else "longer than it says"
        raise InputError(
            f"{path}: {wrong}; {frames} frames of {points} points need {frames * a_frame} bytes, found {size} "
            f"({size // a_frame} whole frames)"
        )
