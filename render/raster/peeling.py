"""Depth peeling: of all faces that cover a pixel's centre, which are the nearest, second nearest and so on."""

from __future__ import annotations

import numpy as np

from render.raster.screen import ScreenFaces

# Depths are compared in steps of this fraction of the nearest one's reciprocal: surfaces that lie on one another are
# at one depth whatever float64 rounding (1e-16 of it) makes of them, and a step is far below any cloth's thickness
# (0.2 nm at 2 m).
_STEP = 1e-10


class NearestLayers:
    """The nearest faces at every pixel centre, in an order that knows no ties and does not depend on who drew.

    Whoever finds that a face covers a pixel's centre adds the pair; depth is evaluated here, in float64 and
    from the face's plane. Of faces at the same depth the one with the lower index is the nearer.

    Args:
        faces: projected faces.
        size: (height, width).
        layers: how many of the nearest faces are kept, L.
    """

    def __init__(self, faces: ScreenFaces, size: tuple[int, int], layers: int) -> None:
        self._faces, self._size = faces, size
        self._index = np.full((layers, size[0] * size[1]), -1, np.int64)
        self._depth = np.zeros(self._index.shape, np.int64)
        corners = faces.reciprocal_depth(np.arange(len(faces.ids))[:, None], faces.corners)
        self._scale = 1 / (_STEP * corners.max(initial=1e-12))

    def add(self, pixel: np.ndarray, index: np.ndarray) -> None:
        """Take in that faces cover pixel centres; each pair may come once.

        Args:
            pixel: (P,) integer, row * width + column.
            index: (P,) integer, into the projected faces.
        """
        layers, width = len(self._index), self._size[1]
        centre = np.stack([pixel % width, pixel // width], axis=1) + 0.5
        # Steps are counted from the camera's far side on: larger is nearer.
        depth = np.round(self._faces.reciprocal_depth(index, centre) * self._scale).astype(np.int64)
        seen = np.zeros(self._index.shape[1], bool)
        seen[pixel] = True
        touched = np.flatnonzero(seen)
        if layers == 1 and len(touched) == len(pixel):
            self._replace_nearest(pixel, index, depth)
            return
        known = self._index[:, touched]
        layer, place = np.nonzero(known >= 0)
        pixel = np.concatenate([pixel, touched[place]])
        index = np.concatenate([index, known[layer, place]])
        depth = np.concatenate([depth, self._depth[layer, touched[place]]])
        order = np.lexsort((index, -depth, pixel))
        pixel, index, depth = pixel[order], index[order], depth[order]
        first = np.flatnonzero(np.diff(pixel, prepend=-1))
        rank = np.arange(len(pixel)) - np.repeat(first, np.diff(first, append=len(pixel)))
        kept = rank < layers
        self._index[rank[kept], pixel[kept]] = index[kept]
        self._depth[rank[kept], pixel[kept]] = depth[kept]

    def _replace_nearest(self, pixel: np.ndarray, index: np.ndarray, depth: np.ndarray) -> None:
        """`add` for one layer and pixels that differ, which needs no sorting."""
        known, known_depth = self._index[0, pixel], self._depth[0, pixel]
        nearer = (known < 0) | (depth > known_depth) | ((depth == known_depth) & (index < known))
        self._index[0, pixel[nearer]] = index[nearer]
        self._depth[0, pixel[nearer]] = depth[nearer]

    @property
    def face_id(self) -> np.ndarray:
        """(L, height, width) int32, index in the mesh's faces, -1 where fewer faces cover the pixel's centre."""
        face = self._faces.ids[self._index] if len(self._faces.ids) else self._index
        return np.where(self._index >= 0, face, -1).astype(np.int32).reshape(-1, *self._size)
