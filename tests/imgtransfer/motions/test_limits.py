"""Joint angles of anatomy as rotations of SMPL's joints: by hand, and the same on both sides."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import INDEX, JOINTS, global_rotations, segment_direction
from imgtransfer.motions.limits import LIMITS, NEUTRAL, poses_from_angles, within_limits

DOWN, FORWARD = np.array([0.0, -1, 0]), np.array([0.0, 0, 1])
TURNED_BY_A_MIRROR = ("yaw", "roll", "side", "twist", "look")  # trunk angles that change their sign


def posed(**degrees):
    """(22, 3, 3) global rotations with these angles and the neutral ones for the others, all set to 0."""
    angles = {name: np.array([float(degrees.get(name, 0.0))]) for name in LIMITS}
    return global_rotations(poses_from_angles(angles))[0]


def of(rotations, joint, direction):
    return rotations[INDEX[joint]] @ direction


def test_angles_are_clipped_and_missing_ones_neutral():
    angles = within_limits({"bend": np.array([-90.0, 10.0, 90.0]), "left_elbow": np.float64(-5)}, 3)
    assert set(angles) == set(LIMITS)
    assert angles["bend"].tolist() == [-25, 10, 65]
    assert angles["left_elbow"].tolist() == [2, 2, 2]
    assert angles["right_elbow"].tolist() == [NEUTRAL["right_elbow"]] * 3
    assert all(values.shape == (3,) and values.dtype == np.float64 for values in angles.values())


def test_standing_is_within_every_limit_and_alike_on_both_sides():
    for name, (low, high) in LIMITS.items():
        assert low <= NEUTRAL[name] <= high
        if name.startswith("left_"):
            other = name.replace("left", "right")
            assert (LIMITS[other], NEUTRAL[other]) == ((low, high), NEUTRAL[name])


def test_with_all_angles_at_zero_the_arms_hang_and_nothing_else_turns():
    rotations = posed()
    for number, joint in enumerate(JOINTS):
        if not joint.endswith(("shoulder", "elbow", "wrist")):
            np.testing.assert_allclose(rotations[number], np.eye(3), atol=1e-12)
    # The T-pose's arm, which points a little down and back, turned by 90 degrees in the frontal plane.
    x, y, z = segment_direction("upper_arm", "left")
    np.testing.assert_allclose(of(rotations, "left_shoulder", [x, y, z]), [y, -x, z], atol=1e-12)


@pytest.mark.parametrize(("angle", "joint", "start", "end"), [
    ("pitch", "pelvis", [0, 1, 0], [0, np.sqrt(3) / 2, 0.5]),  # forward
    ("yaw", "pelvis", FORWARD, [0.5, 0, np.sqrt(3) / 2]),  # to its left, which is +x
    ("roll", "pelvis", [0, 1, 0], [-0.5, np.sqrt(3) / 2, 0]),  # to its right
    ("bend", "spine3", [0, 1, 0], [0, np.sqrt(3) / 2, 0.5]),
    ("side", "spine3", [0, 1, 0], [-0.5, np.sqrt(3) / 2, 0]),
    ("twist", "spine3", FORWARD, [0.5, 0, np.sqrt(3) / 2]),
    ("nod", "head", FORWARD, [0, -0.5, np.sqrt(3) / 2]),
    ("look", "head", FORWARD, [0.5, 0, np.sqrt(3) / 2]),
    ("left_hip", "left_hip", DOWN, [0, -np.sqrt(3) / 2, 0.5]),
    ("left_spread", "left_hip", DOWN, [0.5, -np.sqrt(3) / 2, 0]),
    ("right_spread", "right_hip", DOWN, [-0.5, -np.sqrt(3) / 2, 0]),
    ("left_turn_out", "left_hip", FORWARD, [0.5, 0, np.sqrt(3) / 2]),
    ("left_knee", "left_knee", DOWN, [0, -np.sqrt(3) / 2, -0.5]),  # the foot goes back
    ("left_ankle", "left_ankle", FORWARD, [0, -0.5, np.sqrt(3) / 2]),  # the toes go down
    ("left_swing", "left_shoulder", [1, 0, 0], [0, -np.sqrt(3) / 2, 0.5]),  # a hanging arm forward
    ("right_raise", "right_shoulder", [-1, 0, 0], [-0.5, -np.sqrt(3) / 2, 0]),  # a hanging arm sideways
    ("left_elbow", "left_elbow", [1, 0, 0], [0, -np.sqrt(3) / 2, 0.5]),
])  # fmt: skip
def test_thirty_degrees_of_each_angle_by_hand(angle, joint, start, end):
    np.testing.assert_allclose(of(posed(**{angle: 30}), joint, start), end, atol=1e-12)


def test_rolling_an_arm_in_turns_it_about_itself():
    plain, rolled = posed(left_raise=40), posed(left_raise=40, left_roll_in=25)
    np.testing.assert_allclose(
        of(rolled, "left_shoulder", [1, 0, 0]), of(plain, "left_shoulder", [1, 0, 0]), atol=1e-12
    )
    turn = Rotation.from_matrix(rolled[INDEX["left_shoulder"]] @ plain[INDEX["left_shoulder"]].T)
    assert np.degrees(turn.magnitude()) == pytest.approx(25)


@pytest.mark.parametrize("raised", [20, 60, 100, 150])
def test_a_high_arm_is_raised_by_collar_and_shoulder_together(raised):
    rotations = posed(left_raise=raised)
    angle = np.radians(raised)
    np.testing.assert_allclose(
        of(rotations, "left_shoulder", [1, 0, 0]), [np.sin(angle), -np.cos(angle), 0], atol=1e-12
    )
    collar = np.degrees(Rotation.from_matrix(rotations[INDEX["left_collar"]]).magnitude())
    assert collar == pytest.approx(max(0, (raised - 60) / 4))


def test_a_mirrored_body_has_the_mirrored_angles():
    random = np.random.default_rng(0)
    angles = {name: random.uniform(*np.clip(LIMITS[name], -90, 90), 5) for name in LIMITS}
    swap = {"left": "right", "right": "left"}

    def other(name):
        side, _, rest = name.partition("_")
        return f"{swap[side]}_{rest}" if side in swap else name

    mirrored = {other(n): -values if n in TURNED_BY_A_MIRROR else values for n, values in angles.items()}
    poses, reflected = poses_from_angles(angles), poses_from_angles(mirrored)
    swapped = [INDEX[other(joint)] for joint in JOINTS]
    np.testing.assert_allclose(reflected, poses[:, swapped] * [1, -1, -1], atol=1e-12)
