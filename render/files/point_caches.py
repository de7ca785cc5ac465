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

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.data_file import check_data_file
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


@dataclass(frozen=True, eq=False)
class PointCache:
    """Vertices (T, N, 3) float32 in the file's units and axes; `fps` where the file has times, else None."""

    vertices: np.ndarray
    fps: float | None


def read_cache(path: Path) -> PointCache:
    """Read a .pc2, .pc16 or .mdd file.

    Raises:
        InputError: no such file, another format, a truncated or overlong one, no frames, or values not finite.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a point cache must be one of {', '.join(SUFFIXES)}, found '{suffix}'")
    check_data_file(path, f"a point cache ({suffix})")
    content = path.read_bytes()
    cache = _read_mdd(path, content) if suffix == ".mdd" else _read_pc2(path, content, half=suffix == ".pc16")
    check_finite(cache.vertices, str(path), limit=FARTHEST_IN_FILES, unit="")  # in the file's unit
    return cache


def _read_pc2(path: Path, content: bytes, *, half: bool) -> PointCache:
    if len(content) < _PC2_HEADER.itemsize or not content.startswith(b"POINTCACHE2"):
        raise InputError(f"{path}: not a point cache; its first bytes must be POINTCACHE2")
    header = np.frombuffer(content, _PC2_HEADER, 1)[0]
    kind = np.dtype("<f2" if half else "<f4")
    other = np.dtype("<f4" if half else "<f2")
    points, samples, size = int(header["points"]), int(header["samples"]), len(content) - _PC2_HEADER.itemsize
    if points > 0 and samples > 0 and size == points * samples * 3 * other.itemsize:
        wrong = "PC2 with 32-bit" if half else "PC16 with 16-bit"
        raise InputError(
            f"{path}: mislabelled, it holds {wrong} floats; rename it to {'.pc2' if half else '.pc16'}"
        )
    return PointCache(_vertices(path, content[_PC2_HEADER.itemsize :], samples, points, kind), None)


def _read_mdd(path: Path, content: bytes) -> PointCache:
    if len(content) < 8:
        raise InputError(f"{path}: truncated, an MDD file begins with two numbers")
    frames, points = (int(value) for value in np.frombuffer(content, ">i4", 2))
    if frames < 1 or points < 1 or len(content) < 8 + 4 * frames:
        raise InputError(f"{path}: not an MDD point cache; it would have {frames} frames of {points} points")
    vertices = _vertices(path, content[8 + 4 * frames :], frames, points, np.dtype(">f4"))
    times = np.frombuffer(content, ">f4", frames, 8).astype(np.float64)
    if not np.isfinite(times).all():
        raise InputError(f"{path}: the frames' times are not finite; the file is damaged")
    seconds = times[-1] - times[0]
    steady = frames > 1 and seconds > 0 and np.allclose(np.diff(times), seconds / (frames - 1), rtol=0.01)
    return PointCache(vertices, round((frames - 1) / seconds, 3) if steady else None)


def _vertices(path: Path, content: bytes, frames: int, points: int, kind: np.dtype) -> np.ndarray:
    if frames < 1 or points < 1:
        raise InputError(f"{path}: the cache says that it has {frames} frames of {points} points")
    wanted, found = frames * points * 3 * kind.itemsize, len(content)
    if wanted != found:
        kind_of = "truncated" if found < wanted else "longer than it says"
        raise InputError(
            f"{path}: {kind_of}; {frames} frames of {points} points need {wanted} bytes, found {found} "
            f"({found // (points * 3 * kind.itemsize)} whole frames)"
        )
    return np.frombuffer(content, kind, frames * points * 3).reshape(frames, points, 3).astype(np.float32)
