"""SMPL's joint tree and T-pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import (
    INDEX,
    JOINTS,
    PARENTS,
    SEGMENT_DIRECTIONS,
    global_rotations,
    local_poses,
    segment_direction,
)


def test_the_tree_is_smpls():
    assert len(JOINTS) == len(PARENTS) == len(set(JOINTS)) == 22
    assert all(parent < joint for joint, parent in enumerate(PARENTS))
    chain, joint = [], INDEX["right_wrist"]
    while joint >= 0:
        chain.append(JOINTS[joint])
        joint = PARENTS[joint]
    assert chain == [
        "right_wrist",
        "right_elbow",
        "right_shoulder",
        "right_collar",
        "spine3",
        "spine2",
        "spine1",
        "pelvis",
    ]


def test_both_sides_hang_from_the_same_places():
    for name in JOINTS:
        if name.startswith("left_"):
            left, right = (JOINTS[PARENTS[INDEX[n]]] for n in (name, name.replace("left", "right")))
            assert left.replace("left", "right") == right


@pytest.mark.parametrize("segment", SEGMENT_DIRECTIONS)
def test_segments_are_unit_and_mirrored(segment):
    left, right = segment_direction(segment, "left"), segment_direction(segment, "right")
    assert np.linalg.norm(left) == pytest.approx(1)
    assert np.array_equal(left * [-1, 1, 1], right)
    again = segment_direction(segment, "left")
    assert np.array_equal(again, left)  # the table was not changed by the right side


def test_rotations_are_products_along_the_chain():
    poses = np.random.default_rng(0).normal(0, 1, (2, 22, 3))
    rotations = global_rotations(poses)
    for frame in range(2):
        for joint in range(22):
            wanted, at = np.eye(3), joint
            while at >= 0:
                wanted, at = Rotation.from_rotvec(poses[frame, at]).as_matrix() @ wanted, PARENTS[at]
            np.testing.assert_allclose(rotations[frame, joint], wanted, atol=1e-12)


def test_local_poses_undo_them_and_leave_their_input_alone():
    rotations = global_rotations(np.random.default_rng(1).normal(0, 0.5, (3, 22, 3)))
    before = rotations.copy()
    np.testing.assert_allclose(global_rotations(local_poses(rotations)), rotations, atol=1e-12)
    assert np.array_equal(rotations, before)


def test_no_frames_stay_none():
    assert global_rotations(np.zeros((0, 22, 3))).shape == (0, 22, 3, 3)
