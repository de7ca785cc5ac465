"""Polygons as scene files keep them, one list of corners for all, cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from render.errors import InputError


@dataclass(frozen=True, eq=False)
class Polygons:
    """The polygons of one mesh.

    Args:
        counts: (P,) how many corners each has. vertices: (C,) the vertex of each corner, one polygon after the other.
        source: what messages call the mesh.

    Raises:
        InputError: a polygon of fewer than three corners, or another number of corners than the polygons count.
    """

    counts: np.ndarray
    vertices: np.ndarray
    source: str

    def __post_init__(self) -> None:
        few = np.flatnonzero(self.counts < 3)
        if len(few):
            raise InputError(
                f"{self.source}: polygon {few[0]} has {self.counts[few[0]]} corners; three or more are wanted"
            )
        if self.counts.sum() != len(self.vertices):
            raise InputError(
                f"{self.source}: its polygons count {self.counts.sum()} corners, but it has {len(self.vertices)}"
            )

    def same(self, counts: np.ndarray, vertices: np.ndarray) -> bool:
        """Whether these are the same polygons in the same order."""
        return np.array_equal(self.counts, counts) and np.array_equal(self.vertices, vertices)

    def triangles(self, *, backwards: bool) -> tuple[np.ndarray, np.ndarray]:
        """Fans around each polygon's first corner, as OBJ files are cut.

        Args:
            backwards: take each polygon's corners from the last to the first.

        Returns:
            (F, 3) int64 indices of corners, and (F,) the polygon of each triangle.
        """
        counts = self.counts.astype(np.int64)
        cut = counts - 2
        polygon = np.repeat(np.arange(len(counts)), cut)
        number = np.arange(cut.sum()) - np.repeat(np.cumsum(cut) - cut, cut)
        places = np.stack([np.zeros_like(number), number + 1, number + 2], axis=1)
        if backwards:
            places = (counts[polygon] - 1)[:, None] - places
        return (np.cumsum(counts) - counts)[polygon][:, None] + places, polygon
