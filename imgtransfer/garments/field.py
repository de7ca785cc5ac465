"""Scalar fields on a regular grid whose zero level is a garment's surface; negative within."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import gaussian_filter, map_coordinates

from fusion import BodySdf
from imgtransfer.garments.cutting import largest_component
from imgtransfer.garments.figure import ANGLES
from render.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Field:
    """Values (X, Y, Z) float64 at `low` + `cell` · (i, j, k); lengths in metres."""

    values: np.ndarray
    low: np.ndarray
    cell: float

    @property
    def heights(self) -> np.ndarray:
        """(Y,) metres."""
        return self.low[1] + self.cell * np.arange(self.values.shape[1])

    @property
    def points(self) -> np.ndarray:
        """(X, Y, Z, 3) metres."""
        axes = [self.low[i] + self.cell * np.arange(n) for i, n in enumerate(self.values.shape)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def smoothed(self, metres: float) -> Field:
        """Convolved with a Gaussian of that standard deviation."""
        return replace(self, values=gaussian_filter(self.values, metres / self.cell))

    def with_values(self, values: np.ndarray) -> Field:
        """Other values on the same grid."""
        return replace(self, values=values)

    def surface(self, source: str) -> Mesh:
        """The largest piece of the zero level, counter-clockwise from outside; open where the grid ends."""
        from skimage.measure import marching_cubes  # noqa: PLC0415

        vertices, faces, _, _ = marching_cubes(self.values, 0.0, spacing=(self.cell,) * 3)
        return largest_component(Mesh(vertices + self.low, faces.astype(np.int64), source))

    def project(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) points moved onto the zero level along the gradient."""
        at = ((points - self.low) / self.cell).T

        def sample(step: np.ndarray | float) -> np.ndarray:
            return map_coordinates(self.values, at + step, order=1, mode="nearest")

        steps = np.eye(3)[:, :, None]
        slope = np.stack([sample(step) - sample(-step) for step in steps], axis=-1) / (2 * self.cell)
        return points - (sample(0.0) / np.maximum((slope**2).sum(-1), 0.1))[:, None] * slope


def body_distance(
    vertices: np.ndarray, faces: np.ndarray, low: np.ndarray, high: np.ndarray, *, cell: float, band: float
) -> Field:
    """Signed distance to a closed body mesh on a grid.

    Args:
        vertices: (B, 3) metres. faces: (G, 3).
        low, high: (3,) corners of the grid, metres. cell: its spacing, metres.
        band: metres outside the body beyond which the distance stays at this value.
    """
    shape = np.ceil((high - low) / cell).astype(int) + 1
    grid = Field(np.empty(shape), np.asarray(low, np.float64), cell)
    sdf = BodySdf(np.asarray(faces), len(vertices), band_m=band)
    sdf.update(vertices.astype(np.float32))
    points = torch.from_numpy(grid.points.reshape(-1, 3).astype(np.float32))
    return grid.with_values(sdf.distance(points).numpy().reshape(shape).astype(np.float64))


def hull_distance(grid: Field, axis: np.ndarray, supports: np.ndarray) -> np.ndarray:
    """(X, Y, Z) signed horizontal distance to a convex section at every height of a grid.

    Args:
        grid: its values are not used.
        axis: (3,) a point of the vertical line that `supports` are measured from.
        supports: (Y, 64) distance of the section's tangents from the axis in the directions `ANGLES`.

    Returns:
        Exact inside and before the middle of a side; outside, near a corner, smaller than the distance.
    """
    level = grid.points[:, 0][..., [0, 2]] - axis[[0, 2]]  # (X, Z, 2)
    reach = level @ np.stack([np.cos(ANGLES), np.sin(ANGLES)])  # (X, Z, 64)
    return np.stack([(reach - support).max(axis=-1) for support in supports], axis=1)


def hanging(supports: np.ndarray, heights: np.ndarray, top: float) -> np.ndarray:
    """Sections (Y, 64) of cloth that falls straight down from the widest section above it.

    Args:
        supports: (Y, 64) of the body, nan where there is none.
        heights: (Y,) metres, ascending.
        top: height from which cloth hangs; above it sections stay the body's.
    """
    known = np.flatnonzero(np.isfinite(supports).all(axis=1))
    filled = supports[known[np.clip(np.searchsorted(known, np.arange(len(supports))), 0, len(known) - 1)]]
    below = heights <= top
    fallen = filled.copy()
    fallen[below] = np.maximum.accumulate(filled[below][::-1], axis=0)[::-1]
    return gaussian_filter(fallen, (2.0, 0.0), mode="nearest")
