"""Linear blend skinning of a clip's body: joint transforms from its poses, and points moved by them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from render import InputError


def joint_transforms(clip: Clip) -> np.ndarray:
    """Transforms from the rest pose to each frame, (T, K, 3, 4) float64, one a column of the weights.

    The clip's own where it has them; else from its poses as in SMPL: each joint turns about its rest place
    within its parent's frame, joint 0 about its own, and then `trans` is added.

    Raises:
        InputError: the clip has neither, or they do not fit its blend weights.
    """
    skeleton = clip.skeleton
    if skeleton.joint_transforms is not None:
        transforms = skeleton.joint_transforms.astype(np.float64)
    else:
        missing = [k for k in ("poses", "trans", "joints_rest", "parents") if getattr(skeleton, k) is None]
        if missing:
            raise InputError(
                f"{clip.name}: no skinning; it lacks joint_transforms, and also {', '.join(missing)}"
            )
        transforms = _from_poses(clip)
    if skeleton.blend_weights is not None and skeleton.blend_weights.shape[1] != transforms.shape[1]:
        raise InputError(
            f"{clip.name}: blend_weights have {skeleton.blend_weights.shape[1]} columns "
            f"for {transforms.shape[1]} joints"
        )
    return transforms


def skin(rest: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Linear blend skinning.

    Args:
        rest: (N, 3), metres.
        weights: (N, K), rows that sum to 1.
        transforms: (T, K, 3, 4), rest to posed.

    Returns:
        (T, N, 3) float64.
    """
    homogeneous = np.concatenate([rest, np.ones((len(rest), 1))], axis=1).astype(np.float64)
    weights = weights.astype(np.float64)
    frames = []
    for frame in transforms:  # one frame at a time: (T, N, 3, 4) would be large
        blended = (weights @ frame.reshape(len(frame), 12)).reshape(-1, 3, 4)
        frames.append(np.einsum("nab,nb->na", blended, homogeneous))
    return np.stack(frames)


def _from_poses(clip: Clip) -> np.ndarray:
    skeleton = clip.skeleton
    poses, trans = np.asarray(skeleton.poses, np.float64), np.asarray(skeleton.trans, np.float64)
    joints, parents = np.asarray(skeleton.joints_rest, np.float64), np.asarray(skeleton.parents)
    n_frames, n_joints = poses.shape[:2]
    if not n_joints == len(joints) == len(parents) or any(parent >= j for j, parent in enumerate(parents)):
        raise InputError(
            f"{clip.name}: {n_joints} joints in poses, {len(joints)} in joints_rest, "
            f"{len(parents)} in parents; these must agree, and a parent must come before its children"
        )
    turns = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(n_frames, n_joints, 3, 3)
    transforms = np.empty((n_frames, n_joints, 3, 4))
    for joint, parent in enumerate(parents):
        shift = joints[joint] - turns[:, joint] @ joints[joint]
        about = np.concatenate([turns[:, joint], shift[..., None]], -1)
        if parent < 0:
            transforms[:, joint] = about
        else:
            above = transforms[:, parent]
            transforms[:, joint] = above[..., :3] @ about
            transforms[:, joint, :, 3] += above[..., 3]
    transforms[..., 3] += trans[:, None]
    return transforms
