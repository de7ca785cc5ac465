"""Reader of BVH files, by bvhio, and how their skeletons fit onto the 22 SMPL joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS, PARENTS, local_poses, segment_direction
from imgtransfer.motions.bvh_text import check_bvh
from imgtransfer.motions.motion import Motion, of_file, resample
from imgtransfer.motions.skeletons import named_joints
from imgtransfer.running.extras import optional
from render import InputError

LEG_LENGTH = 0.8  # metres, to which every skeleton is scaled; units of BVH files are anybody's guess
# Which segment starts at a joint and where it ends; the hand keeps the forearm's correction.
_SEGMENTS = {"hip": ("thigh", "knee"), "knee": ("shin", "ankle"), "shoulder": ("upper_arm", "elbow"),
             "elbow": ("forearm", "wrist"), "wrist": ("forearm", None)}  # fmt: skip


def load_bvh(path: str | Path, *, fps: float = 30.0) -> Motion:
    """Read a motion, put it on SMPL's joints and resample it.

    Joints are found by their names, as CMU, Mixamo and SMPL skeletons call them. The skeleton may rest in any pose,
    with any axis up: how it stands and faces is taken from its own hips and spine at rest. Its size does not
    matter either; it is scaled to legs of 0.8 m.

    Raises:
        InputError: no such file, not a BVH file, no motion in it, or a skeleton without the joints that are needed.
    """
    path = Path(path)
    skeleton = _read(path)
    joints = named_joints(skeleton.names, skeleton.parents, str(path))
    own = _own_axes(skeleton, joints, path)
    rotations = own @ skeleton.rotations() @ own.T
    rest = skeleton.rest @ own.T
    poses = np.empty((len(rotations), len(JOINTS), 3, 3))
    for joint, name in enumerate(JOINTS):
        if name not in joints:  # a joint that the skeleton lacks does not bend
            poses[:, joint] = poses[:, PARENTS[joint]]
            continue
        poses[:, joint] = rotations[:, joints[name]] @ _correction(name, joints, rest)
    leg = _leg_length(rest, joints)
    if not leg > 0:
        raise InputError(
            f"{path}: the skeleton's legs have no length; its hips, knees and ankles are at one point"
        )
    trans = skeleton.root @ own.T * (LEG_LENGTH / leg)
    with of_file(path):
        motion = Motion(local_poses(poses), trans, 1 / skeleton.frame_time, path.stem, LEG_LENGTH)
        return resample(motion, fps)


@dataclass(frozen=True, eq=False)
class _Skeleton:
    """A BVH file's content, in its own axes and units.

    names, parents: of the J joints, parents first, the root's is -1. rest: (J, 3) positions where no joint is turned.
    local: (T, J, 4) quaternions x, y, z, w against the parent. root: (T, 3) positions of the root.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: np.ndarray
    local: np.ndarray
    root: np.ndarray
    frame_time: float

    def rotations(self) -> np.ndarray:
        """(T, J, 3, 3) from rest, in the file's world."""
        turned = (
            Rotation.from_quat(self.local.reshape(-1, 4)).as_matrix().reshape(*self.local.shape[:2], 3, 3)
        )
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                turned[:, joint] = turned[:, parent] @ turned[:, joint]
        return turned


def _read(path: Path) -> _Skeleton:
    check_bvh(path)
    bvhio = optional("bvhio", "simulate", f"{path}: reading BVH")
    try:
        read = bvhio.readAsBvh(str(path))
    except Exception as error:  # its reader raises whatever it meets
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        raise InputError(f"{path}: not a readable BVH file ({' '.join(str(reason).split())})") from error
    if read.FrameCount < 2 or not read.FrameTime > 0:
        raise InputError(
            f"{path}: {read.FrameCount} frames of {read.FrameTime} s; two or more, and a frame time, are wanted"
        )
    names: list[str] = []
    parents: list[int] = []
    rest: list[np.ndarray] = []
    local: list[np.ndarray] = []

    def walk(joint: Any, parent: int) -> None:
        number = len(names)
        names.append(joint.Name)
        parents.append(parent)
        rest.append(np.array(joint.Offset) + (rest[parent] if parent >= 0 else 0.0))
        local.append(np.array([[q.x, q.y, q.z, q.w] for q in (frame.Rotation for frame in joint.Keyframes)]))
        for child in joint.Children:
            walk(child, number)

    walk(read.Root, -1)
    root = np.array([list(frame.Position) for frame in read.Root.Keyframes])
    return _Skeleton(
        tuple(names),
        tuple(parents),
        np.array(rest, np.float64),
        np.stack(local, axis=1).astype(np.float64),
        root.astype(np.float64),
        float(read.FrameTime),
    )


def _own_axes(skeleton: _Skeleton, joints: dict[str, int], path: Path) -> np.ndarray:
    """(3, 3) rotation from the file's axes to ours (x to the body's left, y up), each of them one of the file's."""
    rest = skeleton.rest
    across = rest[joints["left_hip"]] - rest[joints["right_hip"]]
    above = rest[joints["spine3"]] - (rest[joints["left_hip"]] + rest[joints["right_hip"]]) / 2
    left, up = (np.sign(v[i]) * np.eye(3)[i] for v in (across, above) for i in [np.abs(v).argmax()])
    if abs(left @ up) > 0 or not across.any() or not above.any():
        raise InputError(
            f"{path}: the skeleton at rest has its left hip towards {across} and its chest towards {above}; these "
            "should be different axes, a standing skeleton is wanted"
        )
    return np.stack([left, up, np.cross(left, up)])


def _correction(name: str, joints: dict[str, int], rest: np.ndarray) -> np.ndarray:
    """(3, 3) the shortest turn from a segment's direction in the T-pose to where the skeleton has it at rest."""
    side, _, kind = name.partition("_")
    if kind not in _SEGMENTS:
        return np.eye(3)
    segment, end = _SEGMENTS[kind]
    start, stop = (
        joints[f"{side}_{joint}"] for joint in (("elbow", "wrist") if end is None else (kind, end))
    )
    wanted = rest[stop] - rest[start]
    given = segment_direction(segment, side)
    axis = np.cross(given, wanted)
    if np.linalg.norm(axis) <= 1e-9 * np.linalg.norm(wanted):  # along it already, or of no length
        return np.eye(3)
    angle = np.arctan2(np.linalg.norm(axis), given @ wanted)
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()


def _leg_length(rest: np.ndarray, joints: dict[str, int]) -> float:
    """Hip to knee to ankle, mean of both sides, in the file's unit."""
    chains = [[joints[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")] for side in ("left", "right")]
    return float(np.mean([np.linalg.norm(np.diff(rest[chain], axis=0), axis=1).sum() for chain in chains]))
