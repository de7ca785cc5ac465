"""The skin that a garment covers: which vertices, how finely their movement is cut, and points that ride on it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.simulation.config import SolverConfig
from render.extras import optional
from render.mesh.measures import face_areas

_COVERED = 0.06  # metres between the cloth and the skin that it lies on, at most
_FLAT = 0.5e-12  # m², up to which a triangle has no axes


def covered_skin(cloth: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """Which vertices of the resting body (B, 3) the cloth (N, 3) covers: int64 indices; all where it is none."""
    near = np.flatnonzero(cKDTree(cloth).query(skin)[0] < _COVERED)
    return near if len(near) else np.arange(len(skin))


def step_count(before: np.ndarray, start: np.ndarray, end: np.ndarray, solver: SolverConfig) -> int:
    """Substeps of a frame in which the covered skin moves from `start` to `end`, (M, 3) metres each.

    The cloth rides along with what moves all of the skin evenly, by its inertia; what it has to follow is how far a
    vertex goes apart from that, and how much the even movement itself changes. The larger of the two, divided by
    `step_length`, is the number of substeps.

    Args:
        before: (M, 3) metres, where the skin was a frame earlier than at the start.
        start, end: (M, 3) metres, at the two ends of the frame.
        solver: gives `step_length`, and the least and the greatest number.
    """
    displacement = end - start
    even = displacement.mean(axis=0)
    own = np.linalg.norm(displacement - even, axis=1).max()
    change = np.linalg.norm(even - (start - before).mean(axis=0))
    wanted = int(np.ceil(max(own, change) / solver.step_length - 1e-9))
    return min(max(wanted, solver.min_substeps), solver.max_substeps)


class SkinPoints:
    """Points that ride on a skin, such as a waistband: each fixed rigidly to the triangle that it is nearest to.

    Args:
        points: (P, 3) metres, at rest. rest: (B, 3). faces: (G, 3).

    Raises:
        InputError: there are points, and gpytoolbox is not installed.
    """

    def __init__(self, points: np.ndarray, rest: np.ndarray, faces: np.ndarray) -> None:
        self._corners = np.zeros((0, 3), np.int64)
        self._weights = self._offset = np.zeros((0, 3))
        if not len(points):
            return
        rest = rest.astype(np.float64)
        spanning = faces[face_areas(rest, faces) > _FLAT].astype(np.int32)
        _, nearest, self._weights = optional("gpytoolbox", "simulate", "simulation").squared_distance(
            points.astype(np.float64), rest, F=spanning, use_cpp=True
        )
        self._corners = spanning[nearest]
        feet, frames = self._places(rest)
        self._offset = np.einsum("pab,pa->pb", frames, points - feet)

    def at(self, skin: np.ndarray) -> np.ndarray:
        """Skin (..., B, 3) -> points (..., P, 3) float32."""
        feet, frames = self._places(skin.astype(np.float64))
        return (feet + np.einsum("...pab,pb->...pa", frames, self._offset)).astype(np.float32)

    def _places(self, skin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(..., P, 3) the nearest points of the skin, and (..., P, 3, 3) the triangles' axes as columns."""
        corners = skin[..., self._corners, :]
        first = _unit(corners[..., 1, :] - corners[..., 0, :])
        normal = _unit(np.cross(first, corners[..., 2, :] - corners[..., 0, :]))
        frames = np.stack([first, np.cross(normal, first), normal], axis=-1)
        return np.einsum("pk,...pkx->...px", self._weights, corners), frames


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
