"""Points that ride on a skin of which only the vertices are known, such as a waistband."""

from __future__ import annotations

import numpy as np

from imgtransfer.running.extras import optional


class SkinPoints:
    """Points fixed to the triangles of the skin that they are nearest to: rigidly, at the triangle's pace.

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
        spanning = faces[_area(rest[faces]) > 1e-12].astype(np.int32)
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


def _area(corners: np.ndarray) -> np.ndarray:
    """(G,) twice the areas of triangles (G, 3, 3)."""
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
