"""Clips that the tests of methods turn, and what they have in common."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from tests.helpers.clips import with_arrays

TURN = Rotation.from_rotvec([0, 0.7, 0]).as_matrix()
SHIFT = np.array([1.0, 0.2, -3.0])


def turned(clip: Clip) -> Clip:
    """The clip with its whole world turned about the vertical and moved."""
    arrays = clip.arrays()
    poses = arrays["poses"].astype(np.float64)
    poses[:, 0] = (Rotation.from_matrix(TURN) * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    rest = arrays["joints_rest"][0].astype(np.float64)
    trans = (rest + arrays["trans"]) @ TURN.T + SHIFT - rest
    moved = {key: placed(arrays[key]) for key in ("body_vertices", "garment_vertices")}
    return with_arrays(clip, poses=poses.astype(np.float32), trans=trans.astype(np.float32), **moved)


def placed(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) turned and moved as `turned` does."""
    return (points.astype(np.float64) @ TURN.T + SHIFT).astype(np.float32)
