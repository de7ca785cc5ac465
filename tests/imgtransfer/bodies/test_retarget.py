"""From SMPL's joints to Anny's bones, on a mirror-symmetric skeleton in an A-pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.retarget import BLADE_FRACTION, BONES, bone_rotations
from imgtransfer.bodies.smpl import INDEX, JOINTS, global_rotations, segment_direction

NAMES = list(BONES)
# The left side in an A-pose with a slightly bent elbow; the right side mirrors x.
LEFT = {
    "upperarm01": (0.18, 1.4, 0), "lowerarm01": (0.38, 1.2, -0.02), "wrist": (0.55, 1.02, 0.05),
    "finger2-1": (0.62, 0.96, 0.09), "finger3-1": (0.63, 0.95, 0.06), "finger5-1": (0.61, 0.95, 0.01),
    "upperleg01": (0.09, 0.92, 0), "lowerleg01": (0.12, 0.5, 0.02), "foot": (0.13, 0.08, -0.02),
}  # fmt: skip
HEADS = {
    f"{bone}.{letter}": np.array(place) * [sign, 1, 1]
    for bone, place in LEFT.items()
    for letter, sign in (("L", 1), ("R", -1))
}


def span(start, end):
    way = HEADS[end] - HEADS[start]
    return way / np.linalg.norm(way)


def posed(poses=None, **joints):
    """(K, 3, 3) for one frame, with axis-angles of some joints."""
    poses = np.zeros((1, 22, 3)) if poses is None else poses
    for name, vector in joints.items():
        poses[0, INDEX[name]] = vector
    return dict(zip(NAMES, bone_rotations(global_rotations(poses), HEADS)[0], strict=True))


def angle(rotation):
    return Rotation.from_matrix(rotation).magnitude()


def test_parents_come_before_their_children():
    assert [parent for parent in BONES.values() if parent is None] == [None]
    for bone, parent in list(BONES.items())[1:]:
        assert NAMES.index(parent) < NAMES.index(bone)
        assert parent[-2:] == bone[-2:] or parent in ("root", *NAMES[1:9])  # sides hang from the middle only


def test_in_the_t_pose_trunk_and_feet_rest_and_limbs_point_as_smpls():
    bones = posed()
    for bone in ("root", "spine04", "spine01", "neck02", "head", "clavicle.L", "foot.L", "toe3-1.R"):
        np.testing.assert_allclose(bones[bone], np.eye(3), atol=1e-12)
    for side, letter in (("left", "L"), ("right", "R")):
        for segment, bone, start, end in (
            ("upper_arm", "upperarm02", "upperarm01", "lowerarm01"),
            ("forearm", "lowerarm01", "lowerarm01", "wrist"),
            ("hand", "wrist", "wrist", "finger3-1"),
            ("thigh", "upperleg02", "upperleg01", "lowerleg01"),
            ("shin", "lowerleg01", "lowerleg01", "foot"),
        ):
            along = span(f"{start}.{letter}", f"{end}.{letter}")
            moved = bones[f"{bone}.{letter}"] @ along
            np.testing.assert_allclose(moved, segment_direction(segment, side), atol=1e-12)


def test_a_turn_of_the_whole_body_turns_every_bone():
    poses = np.random.default_rng(0).normal(0, 0.3, (3, 22, 3))
    turn = Rotation.from_rotvec([0.4, 2.0, -0.3])
    turned = poses.copy()
    turned[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    before, after = (bone_rotations(global_rotations(p), HEADS) for p in (poses, turned))
    np.testing.assert_allclose(after, turn.as_matrix() @ before, atol=1e-9)


def test_a_mirrored_pose_gives_the_mirrored_bones():
    poses = np.random.default_rng(1).normal(0, 0.3, (2, 22, 3))
    swapped = [INDEX[other_side(name)] for name in JOINTS]
    mirrored = poses[:, swapped] * [1, -1, -1]  # an axis-angle under x -> -x
    flip = np.diag([-1.0, 1, 1])
    before, after = (bone_rotations(global_rotations(p), HEADS) for p in (poses, mirrored))
    for number, bone in enumerate(NAMES):
        other = NAMES.index(bone[:-1] + {"L": "R", "R": "L"}[bone[-1]] if bone[-2] == "." else bone)
        np.testing.assert_allclose(after[:, other], flip @ before[:, number] @ flip, atol=1e-9)


def other_side(name):
    swaps = {"left": "right", "right": "left"}
    side, _, rest = name.partition("_")
    return f"{swaps[side]}_{rest}" if side in swaps else name


def test_frames_are_independent_while_nothing_turns_past_half_a_turn():
    poses = np.random.default_rng(2).normal(0, 0.3, (4, 22, 3))
    rotations = global_rotations(poses)
    whole = bone_rotations(rotations, HEADS)
    for frame in range(4):
        np.testing.assert_allclose(
            bone_rotations(rotations[frame : frame + 1], HEADS)[0], whole[frame], atol=1e-9
        )


@pytest.mark.parametrize(("joint", "bone"), [("spine1", "spine04"), ("neck", "neck01"), ("head", "neck03")])
def test_bones_that_smpl_lacks_go_halfway(joint, bone):
    bones = posed(**{joint: [0, 0.8, 0]})
    np.testing.assert_allclose(bones[bone], Rotation.from_rotvec([0, 0.4, 0]).as_matrix(), atol=1e-9)


def test_the_forearm_takes_half_of_the_hands_twist():
    axis = segment_direction("forearm", "left")
    plain, turned = posed(), posed(left_wrist=1.0 * axis)
    assert np.array_equal(turned["lowerarm01.L"], plain["lowerarm01.L"])
    change = turned["lowerarm02.L"] @ plain["lowerarm02.L"].T
    np.testing.assert_allclose(Rotation.from_matrix(change).as_rotvec(), 0.5 * axis, atol=1e-9)
    assert angle(turned["wrist.L"] @ plain["wrist.L"].T) == pytest.approx(1.0)


def test_the_upper_arms_twist_is_halved_near_the_shoulder_and_never_reaches_the_blade():
    axis = segment_direction("upper_arm", "right")
    plain, turned = posed(), posed(right_shoulder=0.6 * axis)
    np.testing.assert_allclose(turned["shoulder01.R"], plain["shoulder01.R"], atol=1e-9)
    assert angle(turned["upperarm01.R"] @ plain["upperarm01.R"].T) == pytest.approx(0.3)
    assert angle(turned["upperarm02.R"] @ plain["upperarm02.R"].T) == pytest.approx(0.6)


@pytest.mark.parametrize("vector", [[0, 0, 0], [0, 0, 0.7], [0.3, -0.5, -0.6]])
def test_the_blade_takes_its_part_of_the_upper_arms_swing(vector):
    bones = posed(left_shoulder=vector)
    rest = span("upperarm01.L", "lowerarm01.L")
    # The shortest turn that carries the arm from where it rests to where it points is its swing.
    swing = np.arccos(rest @ bones["upperarm02.L"] @ rest)
    assert angle(bones["shoulder01.L"]) == pytest.approx(BLADE_FRACTION * swing, abs=1e-9)


def test_the_thighs_twist_is_halved_near_the_hip():
    axis = segment_direction("thigh", "left")
    plain, turned = posed(), posed(left_hip=0.5 * axis)
    assert angle(turned["upperleg01.L"] @ plain["upperleg01.L"].T) == pytest.approx(0.25)
    assert angle(turned["upperleg02.L"] @ plain["upperleg02.L"].T) == pytest.approx(0.5)
