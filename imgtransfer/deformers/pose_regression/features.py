"""What the regression sees of a clip: the turns of the body's joints, and what they were a moment before."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from render import InputError

SIZE = 9  # numbers of a joint at one time


def pose_features(clip: Clip, history_s: float) -> np.ndarray:
    """The turns of all joints now and `history_s` before, by time, so that a clip's rate does not count.

    Args:
        clip: with poses.
        history_s: seconds; between two frames the features are interpolated, and before the first they are its.

    Returns:
        (T, J, 2, 9) float64: of each joint its rotation against its parent, row by row; of joint 0, whose heading says
        nothing of the cloth, where the vertical is in its own axes, and then zeros.

    Raises:
        InputError: a clip without poses.
    """
    poses = clip.skeleton.poses
    if poses is None:
        raise InputError(
            f"{clip.name}: lacks poses, which pose_regression sees; import the clip with its skeleton, or choose "
            "another method"
        )
    matrices = Rotation.from_rotvec(poses.reshape(-1, 3).astype(np.float64)).as_matrix()
    now = matrices.reshape(*poses.shape[:2], SIZE)
    upright = now[:, 0, 3:6].copy()  # the matrix's second row is the vertical in the joint's axes
    now[:, 0] = 0
    now[:, 0, :3] = upright
    return np.stack([now, before(now, history_s * clip.fps)], axis=2)


def before(values: np.ndarray, frames: float) -> np.ndarray:
    """Values (T, ...) as they were so many frames before, any number from 0 on; the first ones before the start."""
    place = np.maximum(np.arange(len(values)) - frames, 0)
    lower = np.floor(place).astype(int)
    upper = np.minimum(lower + 1, len(values) - 1)
    part = (place - lower).reshape(-1, *[1] * (values.ndim - 1))
    past: np.ndarray = (1 - part) * values[lower] + part * values[upper]
    return past
