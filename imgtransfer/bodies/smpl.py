"""The 22 body joints of SMPL: names, tree, and rotations along it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

JOINTS = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
INDEX = {name: number for number, name in enumerate(JOINTS)}

# Directions of the left side's segments in the T-pose (zero pose), y up, facing +z; the right side mirrors x.
SEGMENT_DIRECTIONS = {
    "thigh": (0.09, -0.995, 0.0),
    "shin": (-0.03, -0.993, -0.11),
    "upper_arm": (0.99, -0.05, -0.105),
    "forearm": (1.0, 0.035, 0.0),
    "hand": (1.0, 0.0, 0.0),
}
# The middle of the hip joints seen from the pelvis joint, metres.
HIP_MIDDLE = np.array([0.0, -0.09, 0.0])


def segment_direction(segment: str, side: str) -> np.ndarray:
    """(3,) unit direction of a segment in the T-pose; `side` is "left" or "right"."""
    direction = np.array(SEGMENT_DIRECTIONS[segment])
    if side == "right":
        direction[0] = -direction[0]
    return direction / np.linalg.norm(direction)


def global_rotations(poses: np.ndarray) -> np.ndarray:
    """(T, 22, 3) local axis-angle, radians -> (T, 22, 3, 3) float64 rotations from the T-pose to the world."""
    local = Rotation.from_rotvec(np.asarray(poses, np.float64).reshape(-1, 3)).as_matrix()
    turned = local.reshape(len(poses), len(JOINTS), 3, 3)
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            turned[:, joint] = turned[:, parent] @ turned[:, joint]
    return turned


def local_poses(rotations: np.ndarray) -> np.ndarray:
    """The inverse of `global_rotations`: (T, 22, 3, 3) -> (T, 22, 3) float64, radians."""
    local = np.array(rotations, np.float64)
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            local[:, joint] = np.swapaxes(rotations[:, parent], -1, -2) @ rotations[:, joint]
    return Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(*local.shape[:2], 3)
