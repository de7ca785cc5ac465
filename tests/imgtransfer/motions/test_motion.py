"""What a motion must be, and its frames at other rates."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.motion import MOST_FRAMES, Motion, arms_out, of_file, resample
from render import InputError


def still(frames=3, fps=30.0, **changes):
    values = {"poses": np.zeros((frames, 22, 3)), "trans": np.zeros((frames, 3)), "fps": fps, "name": "stand"}
    return Motion(**(values | changes))


@pytest.mark.parametrize(("changes", "text"), [
    ({"poses": np.zeros((1, 22, 3)), "trans": np.zeros((1, 3))}, r"T of 2 or more, found \(1, 22, 3\)"),
    ({"poses": np.zeros((3, 24, 3))}, r"poses must be \(T, 22, 3\).*found \(3, 24, 3\)"),
    ({"poses": np.zeros((3, 66))}, r"found \(3, 66\)"),
    ({"trans": np.zeros((4, 3))}, r"trans must have shape \(3, 3\), found \(4, 3\)"),
    ({"trans": np.full((3, 3), np.inf)}, "trans"),
    ({"poses": np.full((3, 22, 3), 1e9)}, "poses.*rad"),
    ({"fps": 0.0}, "fps is 0"),
    ({"fps": float("nan")}, "fps is nan"),
])  # fmt: skip
def test_what_is_no_motion_is_refused_in_one_line(changes, text):
    with pytest.raises(InputError, match=text) as caught:
        still(**changes)
    assert str(caught.value).startswith("stand: ")
    assert "\n" not in str(caught.value)


def test_a_motion_lasts_from_its_first_frame_to_its_last():
    assert still(frames=61, fps=30.0).seconds == 2.0


@pytest.mark.parametrize(("message", "wanted"), [
    ("walk: poses are wrong", "folder/walk.npz: poses are wrong"),
    ("folder/walk.npz: cut off", "folder/walk.npz: cut off"),
    ("something else", "folder/walk.npz: something else"),
])  # fmt: skip
def test_messages_about_a_files_motion_name_the_file_once(message, wanted):
    with pytest.raises(InputError) as caught, of_file(Path("folder/walk.npz")):
        raise InputError(message)
    assert str(caught.value) == wanted


def test_errors_of_the_program_stay_what_they_are():
    with pytest.raises(KeyError), of_file(Path("walk.npz")):
        raise KeyError("bug")


def test_rotations_are_resampled_on_the_shorter_way():
    poses = np.zeros((2, 22, 3))
    poses[0, 5], poses[1, 5] = [0, 0, 3.0], [0, 0, -3.0]  # 0.28 rad apart, over the half turn
    middle = resample(still(poses=poses, trans=np.zeros((2, 3)), fps=1.0), 2.0).poses[1, 5]
    assert np.abs(middle) == pytest.approx([0, 0, np.pi])


@pytest.mark.parametrize(
    ("frames", "fps", "wanted"),
    [(4, 30.0, 13), (4, 120.0, 4), (2, 120.0, 2), (11, 100.0, 13), (50, 24.0, 246)],
)
def test_the_last_frame_that_lies_within_is_kept(frames, fps, wanted):
    assert len(resample(still(frames=frames, fps=fps), 120.0).poses) == wanted


def test_a_rate_that_leaves_one_frame_is_refused():
    with pytest.raises(
        InputError, match="less than one frame at 10; a longer motion or an `fps` of 30 is wanted"
    ):
        resample(still(frames=2, fps=30.0), 10.0)


def test_resampling_keeps_name_leg_length_and_places_in_between():
    trans = np.array([[0, 1, 0], [0.3, 1, 0], [0.3, 1, 0.6]])
    after = resample(still(trans=trans, fps=10.0, leg_length=0.77), 20.0)
    assert (after.name, after.leg_length, after.fps) == ("stand", 0.77, 20.0)
    np.testing.assert_allclose(
        after.trans, [[0, 1, 0], [0.15, 1, 0], [0.3, 1, 0], [0.3, 1, 0.3], [0.3, 1, 0.6]]
    )


def test_a_motion_of_hours_is_asked_about():
    with pytest.raises(
        InputError, match=f"70 frames at 0.01 a second are 6.9e[+]03 s.*more than {MOST_FRAMES} frames at 30"
    ):
        resample(still(frames=70, fps=0.01), 30.0)


def hanging(degrees=(20.0, 50.0, 85.0, 110.0)):
    """A motion whose arms are raised to these angles, both alike."""
    poses = np.zeros((len(degrees), 22, 3))
    for side, sign in (("left", 1), ("right", -1)):
        poses[:, JOINTS.index(f"{side}_shoulder"), 2] = sign * np.radians(np.array(degrees) - 90)
    return Motion(poses, np.zeros((len(degrees), 3)), 30.0, "arms", 0.8)


def test_no_degrees_leave_the_arms_alone():
    motion = hanging()
    assert arms_out(motion, 0) is motion


def test_both_arms_turn_out_alike_and_less_the_higher_they_are():
    before, after = hanging(), arms_out(hanging(), 10)
    left, right = (after.poses[:, JOINTS.index(f"{side}_shoulder")] for side in ("left", "right"))
    np.testing.assert_allclose(right, left * [1, -1, -1], atol=1e-12)
    gained = np.degrees(left[:, 2] - before.poses[:, JOINTS.index("left_shoulder"), 2])
    assert gained[0] == pytest.approx(10)
    assert 0 < gained[1] < 10
    np.testing.assert_allclose(gained[2:], 0, atol=1e-12)
    assert (after.name, after.fps, after.leg_length) == ("arms", 30.0, 0.8)


def test_the_arm_turns_as_one_and_in_the_chests_plane():
    motion = hanging((20.0, 20.0))
    motion.poses[:, JOINTS.index("spine2")] = [0.2, 0.9, -0.1]
    motion.poses[:, JOINTS.index("left_elbow"), 1] = -1.2
    after = arms_out(motion, 8).poses
    changed = np.abs(after - motion.poses).max(axis=(0, 2)) > 1e-9
    assert [JOINTS[joint] for joint in np.flatnonzero(changed)] == ["left_shoulder", "right_shoulder"]
    start, end = (Rotation.from_rotvec(p[0, JOINTS.index("left_shoulder")]) for p in (motion.poses, after))
    np.testing.assert_allclose((end * start.inv()).as_rotvec(), [0, 0, np.radians(8)], atol=1e-9)
