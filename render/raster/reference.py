"""The NumPy rasteriser: the reference that the GL one is compared with, and what draws where there is no GL."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.raster.peeling import NearestLayers
from render.raster.screen import ScreenFaces, expand

_CHUNK = 1 << 21  # face-pixel pairs looked at together; bounds the memory to a few hundred MB


def reference_face_ids(faces: ScreenFaces, size: tuple[int, int], layers: int = 1) -> np.ndarray:
    """The nearest faces at every pixel centre, in float64.

    A centre on an edge belongs to one of the two faces beside it (edge rule below), so a closed surface has
    neither holes nor doubly covered pixels. Both sides count.

    Args:
        faces: projected faces.
        size: (height, width).
        layers: how many faces deep, L.

    Returns:
        (L, height, width) int32, -1 where there is no further face.
    """
    height, width = size
    # Pixel columns and rows whose centres lie in each face's bounding box, cut at the image's border.
    first = np.clip(np.ceil(faces.corners.min(axis=1) - 0.5), 0, (width, height)).astype(np.int64)
    last = np.clip(np.floor(faces.corners.max(axis=1) - 0.5), -1, (width - 1, height - 1)).astype(np.int64)
    extent = np.maximum(last - first + 1, 0)
    nearest = NearestLayers(faces, size, layers)
    for part in _chunks(extent.prod(axis=1)):
        owner, number = expand(extent[part].prod(axis=1))
        index = part.start + owner
        cell = first[index] + np.stack([number % extent[index, 0], number // extent[index, 0]], axis=1)
        inside = covers(faces.corners[index], cell + 0.5)
        nearest.add((cell[:, 1] * width + cell[:, 0])[inside], index[inside])
    return nearest.face_id


def _chunks(counts: np.ndarray) -> list[slice]:
    """Consecutive ranges of items, each of which sums to about _CHUNK (or holds a single large item)."""
    if len(counts) == 0:
        return []
    group = np.cumsum(counts) // _CHUNK
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    return [slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], len(counts)], strict=True)]


def covers(corners: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(K,) bool: whether triangles (K, 3, 2) cover points (K, 2).

    The edge function is always evaluated from the end that comes first in (x, y) order and its sign is
    flipped afterwards, so that the two faces at an edge see exactly opposite numbers. A point exactly on the
    edge's line is given to the face on the positive side of the directed edge: one of the two.
    """
    orientation = np.sign(_cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    inside = np.ones(len(points), bool)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        a, b = corners[:, start], corners[:, end]
        swap = (a[:, 0] > b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] > b[:, 1]))
        low, high = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
        above = _cross(high - low, points - low) >= 0  # ties count as above
        face_is_above = (orientation > 0) ^ swap
        inside &= above == face_is_above
    return inside


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
