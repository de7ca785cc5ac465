"""Clips turned and moved as a whole, or with other frames: what a method's prediction must follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment
from tests.helpers.clips import with_arrays

TURN = Rotation.from_rotvec([0, 2.1, 0]).as_matrix()  # about the vertical: gravity stays
SHIFT = np.array([3.0, 0.5, -7.0])


def moved(points: np.ndarray) -> np.ndarray:
    """(..., 3) turned by `TURN`, then moved by `SHIFT`."""
    return (points @ TURN.T + SHIFT).astype(np.float32)


def moved_clip(clip: Clip) -> Clip:
    """The whole clip turned about the vertical and moved, with its root."""
    skeleton = clip.skeleton
    poses, root = skeleton.poses.copy(), skeleton.joints_rest[0]
    poses[:, 0] = (Rotation.from_matrix(TURN) * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = moved(root + skeleton.trans) - root
    return replace(
        clip,
        body=Body(clip.body.rest, clip.body.faces, moved(clip.body.vertices)),
        garment=None if clip.garment is None else Garment(moved(clip.garment.vertices)),
        skeleton=replace(skeleton, poses=poses, trans=trans),
    )


def every_second_frame(clip: Clip) -> Clip:
    """The clip at half its rate."""
    return with_arrays(clip.slice(slice(None, None, 2)), fps=clip.fps / 2)


def mean_distance_mm(predicted: np.ndarray, truth: np.ndarray) -> float:
    return 1e3 * float(np.linalg.norm(predicted - truth, axis=-1).mean())
