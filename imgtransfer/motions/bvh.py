"""Reader of BVH files, and how their skeletons fit onto the 22 SMPL joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from imgtransfer.bodies.smpl import JOINTS, PARENTS, local_poses
from imgtransfer.motions.bvh_skeleton import Skeleton, below, read_skeleton
from imgtransfer.motions.motion import Motion, of_file, resample
from imgtransfer.motions.rest_pose import (
    correction,
    leg_length,
    own_axes,
    shortest_turn,
    standing_turns,
    stands,
)
from imgtransfer.motions.skeletons import named_joints
from imgtransfer.motions.summary import MotionSummary
from imgtransfer.motions.up_axis import UpAxis, axis_name, up_of_world
from render import InputError

LEG_LENGTH = 0.8  # metres, to which every skeleton is scaled; units of BVH files are anybody's guess
_Y = np.array([0.0, 1.0, 0.0])


def read_bvh(
    path: str | Path,
    *,
    fps: float = 30.0,
    up_axis: UpAxis = "auto",
    joints: Mapping[str, str] | None = None,
) -> tuple[Motion, MotionSummary]:
    """Read a motion, put it on SMPL's joints and resample it; and what was taken from the file.

    Joints are found by their names. The skeleton may rest in any pose, with any axis up: how it stands and faces is
    taken from its own hips and spine at rest, and where its limbs are oriented along their bones, from the frames.
    The world's up axis is the skeleton's, unless the body stands along another one in the motion. Its size does not
    matter either; it is scaled to legs of 0.8 m.

    Args:
        fps: of the result.
        up_axis: of the motion's world in the file; "auto" is told from the skeleton and the motion.
        joints: the skeleton's names of some of SMPL's joints, where its names do not tell.

    Raises:
        InputError: no such file, not a BVH file, no motion in it, a skeleton without the joints that are needed, or a
            motion that does not show which axis is up.
    """
    path = Path(path)
    skeleton = read_skeleton(path)
    text = skeleton.text
    numbers = _body(skeleton, joints or {}, path)
    own = own_axes(skeleton.rest, numbers, path)
    rest = skeleton.rest @ own.T
    rotations = own @ skeleton.rotations @ own.T
    at_rest = stands(rest, numbers)
    turns = {} if at_rest else standing_turns(rest, rotations, numbers)
    leg = leg_length(rest, numbers)
    if not leg > 0:
        raise InputError(
            f"{path}: the skeleton's legs have no length; its hips, knees and ankles are at one point"
        )
    place = skeleton.path(numbers["pelvis"])
    # Of joints along their bones only the trunk shows an axis, and that is not the world's.
    axes = own if at_rest else np.eye(3)
    up = up_of_world(
        own.T @ rotations[:, numbers["pelvis"], :, 1].mean(axis=0),
        place / leg,
        axes.T @ _Y,
        up_axis,
        path,
        certain=at_rest,
    )
    world = axes if (axes @ up == _Y).all() else shortest_turn(axes @ up, _Y) @ axes
    if world is not own:
        rotations = world @ own.T @ rotations
    poses = np.empty((len(rotations), len(JOINTS), 3, 3))
    for joint, name in enumerate(JOINTS):
        if name not in numbers:  # a joint that the skeleton lacks does not bend
            poses[:, joint] = poses[:, PARENTS[joint]]
            continue
        turn = turns.get(name, np.eye(3))
        poses[:, joint] = rotations[:, numbers[name]] @ turn.T @ correction(name, numbers, rest, turn)
    trans = place @ world.T * (LEG_LENGTH / leg)
    taken = "rest pose of the file" if at_rest else "joints along their bones, rest pose from the frames"
    if not skeleton.moves(numbers["pelvis"]):
        taken += "; no position channels down to the hips: the body stays in its place"
    with of_file(path):
        motion = Motion(local_poses(poses), trans, skeleton.fps, path.stem, LEG_LENGTH)
        summary = MotionSummary(
            path,
            len(poses),
            skeleton.fps,
            axis_name(up),
            LEG_LENGTH / leg,
            taken,
            {name: text.names[numbers[name]] for name in JOINTS if name in numbers},
            tuple(joints or ()),
        )
        return resample(motion, fps), summary


def _body(skeleton: Skeleton, given: Mapping[str, str], path: Path) -> dict[str, int]:
    """Numbers of the skeleton's joints by SMPL's names; of several roots, those under the one that has a body.

    Raises:
        InputError: no root has all joints that are needed, or several have.
    """
    names, parents = skeleton.text.names, skeleton.text.parents
    roots = [joint for joint, parent in enumerate(parents) if parent < 0]
    if len(roots) == 1:
        return named_joints(names, parents, str(path), given)
    bodies: dict[str, dict[str, int]] = {}
    refusal: InputError | None = None
    for root in sorted(roots, key=lambda root: -len(below(root, parents))):
        inside = below(root, parents)
        own_parents = [-1 if joint == root else inside.index(parents[joint]) for joint in inside]
        try:
            joints = named_joints([names[joint] for joint in inside], own_parents, str(path), given)
        except InputError as error:
            refusal = refusal or error
            continue
        bodies[names[root]] = {name: inside[joint] for name, joint in joints.items()}
    if len(bodies) > 1:
        raise InputError(
            f"{path}: holds {len(bodies)} bodies, under the roots {', '.join(bodies)}; one a file is wanted"
        )
    if not bodies and refusal is not None:
        raise refusal
    return next(iter(bodies.values()))
