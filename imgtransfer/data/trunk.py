"""The rigid motion of a body's trunk, found from its skin alone: for bodies of which no skeleton is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.mesh.measures import area_fractions, face_areas
from render.mesh.rigid import rigid_rotation

# Chosen on training clips of two bodies; on others the garment lies 2 to 7 mm off its place in the root joint's frame.
_CENTRAL = 0.1  # of the skin's area lies within the distance from the centre at which a vertex counts 1 / e
_LEAST = 1e-3  # of the greatest weight; vertices that count less are left out
_FEWEST = 100  # vertices that are left; where there would be fewer, all count
_TOLERANCE = 0.01  # of the body's radius: a vertex so far off counts a quarter
_ITERATIONS = 20


class Trunk:
    """The part of a body about its centre that moves as a rigid piece, frame by frame.

    The centre of the skin's area lies near the root joint in a body at rest. The nearer to it, the more a vertex
    counts; and the farther it is off in a frame, the less, by iteratively reweighted least squares (the squared weights
    of Geman and McClure). So thighs, belly and back count as far as they go with the pelvis in that frame.
    A rigid motion of the whole body is found exactly, and each frame's by itself.

    Args:
        rest: (B, 3) metres, the body at rest; it may be a part of a body. faces: (G, 3) int.

    Attributes:
        centre: (3,) metres, the centre of the area at rest.
    """

    def __init__(self, rest: np.ndarray, faces: np.ndarray) -> None:
        points = rest.astype(np.float64)
        area = np.full(len(points), 1 / len(points))
        if face_areas(points, faces).any():
            area = area_fractions(points, faces)
        self.centre: NDArray[np.float64] = area @ points
        distance = np.linalg.norm(points - self.centre, axis=1)
        nearness = np.exp(-np.square(distance / _quantile(distance, area, _CENTRAL)))
        kept = nearness > _LEAST * nearness.max()
        if kept.sum() < _FEWEST:
            kept = np.ones(len(points), bool)
        self._kept = np.flatnonzero(kept)
        self._rest = points[self._kept] - self.centre
        self._weights = area[self._kept] * nearness[self._kept]
        radius = float(np.sqrt(area @ np.square(distance)))
        self._tolerance = max(_TOLERANCE * radius, float(np.finfo(np.float32).eps))  # a body may be one point

    def motion(
        self, frames: np.ndarray, rotations: np.ndarray | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How the trunk moved from rest, x' = R x + t.

        Args:
            frames: (T, B, 3) metres.
            rotations: (T, 3, 3) float64, R where it is known.

        Returns:
            R (T, 3, 3) and t (T, 3), metres.
        """
        motions = [
            self._fitted(
                frame[self._kept].astype(np.float64), None if rotations is None else rotations[number]
            )
            for number, frame in enumerate(frames)
        ]
        turns, centres = (np.stack(parts) for parts in zip(*motions, strict=True))
        return turns, centres - turns @ self.centre

    def _fitted(self, points: np.ndarray, known: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """The rotation, and where the centre is."""
        weights = self._weights
        for _ in range(_ITERATIONS):
            weights = weights / weights.sum()
            rotation = rigid_rotation(self._rest, points, weights) if known is None else known
            turned = self._rest @ rotation.T
            centre = weights @ (points - turned)
            off = np.square(turned + centre - points).sum(axis=1)
            weights = self._weights / np.square(1 + off / self._tolerance**2)
        return rotation, centre


def _quantile(values: np.ndarray, weights: np.ndarray, fraction: float) -> float:
    """The value that `fraction` of the weights, of sum 1, does not exceed; never 0, so that it can divide."""
    order = np.argsort(values)
    place = int(np.searchsorted(np.cumsum(weights[order]), fraction))
    return max(float(values[order[min(place, len(order) - 1)]]), float(np.finfo(np.float64).tiny))
