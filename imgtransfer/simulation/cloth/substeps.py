"""How finely a frame is cut into steps: by how far the skin under the garment moves in it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.simulation.config import SolverConfig

_UNDER = 0.06  # metres between the cloth and the skin that it lies on


def skin_under(cloth: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """Which vertices of the resting body (B, 3) lie under the cloth (N, 3): int64 indices, all of them if none does."""
    near = np.flatnonzero(cKDTree(cloth).query(skin)[0] < _UNDER)
    return near if len(near) else np.arange(len(skin))


def step_count(before: np.ndarray, start: np.ndarray, end: np.ndarray, solver: SolverConfig) -> int:
    """Substeps of a frame in which the skin under the garment moves from `start` to `end`, (M, 3) metres each.

    The cloth rides along with what moves all of the skin evenly, by its inertia; what it has to follow is how far a
    vertex goes apart from that, and how much the even movement itself changes. The larger of the two, divided by
    `step_length`, is the number of substeps.

    Args:
        before: (M, 3) where the skin was a frame earlier than at the start.
    """
    way = end - start
    even = way.mean(axis=0)
    own = np.linalg.norm(way - even, axis=1).max()
    change = np.linalg.norm(even - (start - before).mean(axis=0))
    wanted = int(np.ceil(max(own, change) / solver.step_length - 1e-9))
    return min(max(wanted, solver.min_substeps), solver.max_substeps)
