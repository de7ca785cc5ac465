"""A clip in which one joint of the body is turned, and all else is as it was (table 3 of JointNet)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.data.skinning import joint_transforms
from render import InputError

_STILL = 1e-3  # metres; what moves less counts as not moved


def turned_joint(clip: Clip, joint: int, turn: np.ndarray) -> Clip:
    """The clip with one joint turned in every frame, without its garment.

    The bones beyond the joint turn about it. Bones that are not the joints of `poses` (a clip with `joint_transforms`)
    count as beyond it where the middle of what they carry is nearest to a limb beyond it; the others stay, also those
    that this body's own rig would let follow a little.

    Args:
        joint: its number in `poses`. turn: (3,) axis-angle in the joint's own axes, radians.

    Raises:
        InputError: no such joint, or a clip without skeleton and skinning.
    """
    skeleton = clip.skeleton
    poses, joints, parents = skeleton.poses, skeleton.joints_rest, skeleton.parents
    if poses is None or joints is None or parents is None or skeleton.blend_weights is None:
        raise InputError(
            f"{clip.name}: robustness turns joints, and needs poses, joints_rest, parents and blend_weights; "
            "leave out `robustness`, or give clips with a skeleton"
        )
    if not (joint < poses.shape[1] == len(joints) == len(parents)):
        raise InputError(
            f"{clip.name}: robustness.joints: no joint {joint}; poses have {poses.shape[1]}, joints_rest {len(joints)}"
        )
    transforms, weights = joint_transforms(clip), skeleton.blend_weights.astype(np.float64)
    rest = clip.body.rest.astype(np.float64)
    owners = (
        np.arange(len(parents))
        if skeleton.joint_transforms is None
        else _owners(rest, weights, joints, parents)
    )
    beyond = np.flatnonzero(_at_or_beyond(parents, joint)[owners])
    if not len(beyond):
        raise InputError(
            f"{clip.name}: robustness.joints: nothing of the body moves with joint {joint} alone"
        )
    first = beyond[((_middles(rest, weights)[beyond] - joints[joint]) ** 2).sum(1).argmin()]
    if skeleton.joint_transforms is None:
        first = joint
    centre = transforms[:, first, :, :3] @ joints[joint].astype(np.float64) + transforms[:, first, :, 3]
    world = _world_rotation(poses, parents, joint)
    own = Rotation.from_rotvec(turn).as_matrix()
    rotation = world @ own @ world.swapaxes(1, 2)
    moved = transforms.copy()
    moved[:, beyond] = rotation[:, None] @ transforms[:, beyond]
    moved[:, beyond, :, 3:] += (centre[..., None] - rotation @ centre[..., None])[:, None]
    changed = poses.copy()
    changed[:, joint] = (Rotation.from_rotvec(poses[:, joint]) * Rotation.from_matrix(own)).as_rotvec()
    given = skeleton.joint_transforms is not None
    return replace(
        clip,
        garment=None,
        body=replace(
            clip.body, vertices=clip.body.vertices + _carried(rest, weights, moved - transforms, beyond)
        ),
        skeleton=replace(
            skeleton, poses=changed, joint_transforms=moved.astype(np.float32) if given else None
        ),
    )


def unmoved_vertices(clip: Clip, turned: Clip) -> np.ndarray:
    """(N,) bool: the garment's vertices whose nearest body vertex at rest is where it was in every frame."""
    moves = np.linalg.norm(turned.body.vertices - clip.body.vertices, axis=-1).max(0) > _STILL
    nearest = cKDTree(clip.body.rest).query(clip.template.vertices)[1]
    return ~moves[nearest]


def _carried(rest: np.ndarray, weights: np.ndarray, change: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """(T, B, 3) float32: how far skinned vertices move where bones' transforms change by (T, K, 3, 4)."""
    homogeneous = np.concatenate([rest, np.ones((len(rest), 1))], 1)
    return np.stack(
        [
            np.einsum("bk,kij,bj->bi", weights[:, bones], frame[bones], homogeneous, optimize=True)
            for frame in change
        ]
    ).astype(np.float32)


def _world_rotation(poses: np.ndarray, parents: np.ndarray, joint: int) -> np.ndarray:
    """(T, 3, 3) float64, a joint's rotation in the world."""
    world = Rotation.from_rotvec(poses[:, joint])
    while (joint := int(parents[joint])) >= 0:
        world = Rotation.from_rotvec(poses[:, joint]) * world
    return world.as_matrix()


def _at_or_beyond(parents: np.ndarray, joint: int) -> np.ndarray:
    """(J,) bool, by joint; a parent stands before its children."""
    beyond = np.zeros(len(parents), bool)
    for number, parent in enumerate(parents):
        beyond[number] = number == joint or (parent >= 0 and beyond[parent])
    return beyond


def _middles(rest: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(K, 3): the middle of what each bone carries."""
    return weights.T @ rest / np.maximum(weights.sum(0), 1e-12)[:, None]


def _owners(rest: np.ndarray, weights: np.ndarray, joints: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """(K,) int: of each bone, the joint whose limb is nearest.

    Its limbs go from it to each of its children; that of a last one goes on as long and straight as the one before.
    """
    places = joints.astype(np.float64)
    inner = [(int(parent), places[number]) for number, parent in enumerate(parents) if parent >= 0]
    last = [
        (number, 2 * places[number] - places[max(int(parents[number]), 0)])
        for number in range(len(parents))
        if number not in set(parents.tolist())
    ]
    owners = np.array([owner for owner, _ in inner + last])
    start, end = places[owners], np.array([point for _, point in inner + last])
    along, offset = end - start, _middles(rest, weights)[:, None] - start
    part = np.clip((offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    nearest: np.ndarray = np.linalg.norm(offset - part[..., None] * along, axis=-1).argmin(1)
    return owners[nearest]
