"""BVH files that the tests write, with skeletons named as CMU, Mixamo and SMPL name theirs."""

import re

import numpy as np
import pytest

from imgtransfer.bodies.smpl import JOINTS, global_rotations, segment_direction
from imgtransfer.motions.bvh import LEG_LENGTH
from imgtransfer.motions.files import load_motion
from imgtransfer.motions.library import make_motion
from imgtransfer.simulation.planning.sources import sorted_sources
from render import InputError
from tests.helpers.bvh_files import MIXAMO, NAMINGS, Z_UP, offsets, write_bvh


@pytest.fixture
def motion():
    return make_motion("mixed", seed=4, seconds=0.4)


@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("order", ["ZYX", "YXZ"])
def test_a_t_posed_skeleton_gives_back_the_poses(tmp_path, motion, naming, order):
    read = load_motion(write_bvh(tmp_path / "a.bvh", motion, NAMINGS[naming], order=order))
    np.testing.assert_allclose(global_rotations(read.poses), global_rotations(motion.poses), atol=2e-5)
    np.testing.assert_allclose(read.trans, motion.trans, atol=1e-4)
    assert read.leg_length == LEG_LENGTH
    assert read.name == "a"


def test_z_up_files_are_turned_to_y_up(tmp_path, motion):
    read = load_motion(write_bvh(tmp_path / "a.bvh", motion, NAMINGS["cmu"], axes=Z_UP))
    np.testing.assert_allclose(global_rotations(read.poses), global_rotations(motion.poses), atol=2e-5)
    np.testing.assert_allclose(read.trans, motion.trans, atol=1e-4)


def test_limbs_point_where_the_skeletons_do_whatever_its_rest_pose(tmp_path, motion):
    hanging = offsets(arms_down=True)
    read = load_motion(write_bvh(tmp_path / "a.bvh", motion, NAMINGS["mixamo"], rest=hanging))
    theirs, ours = global_rotations(motion.poses), global_rotations(read.poses)
    for joint, segment, end in (
        ("shoulder", "upper_arm", "elbow"),
        ("elbow", "forearm", "wrist"),
        ("hip", "thigh", "knee"),
    ):
        for side in ("left", "right"):
            number, direction = JOINTS.index(f"{side}_{joint}"), hanging[JOINTS.index(f"{side}_{end}")]
            wanted = theirs[:, number] @ (direction / np.linalg.norm(direction))
            found = ours[:, number] @ segment_direction(segment, side)
            np.testing.assert_allclose(found, wanted, atol=2e-5)


def test_frames_are_resampled_by_time(tmp_path):
    motion = make_motion("walk", seed=1, seconds=1.0, fps=100.0)
    read = load_motion(write_bvh(tmp_path / "a.BVH", motion, MIXAMO), fps=30.0)
    assert len(read.poses) == 30  # 0.99 s
    np.testing.assert_allclose(
        global_rotations(read.poses[::3]), global_rotations(motion.poses[::10]), atol=1e-4
    )


def test_joints_that_bodies_need_not_have_do_not_bend(tmp_path, motion):
    missing = ("left_foot", "right_foot")
    read = load_motion(write_bvh(tmp_path / "a.bvh", motion, MIXAMO, leave_out=missing))
    for joint in missing:
        np.testing.assert_allclose(read.poses[:, JOINTS.index(joint)], 0, atol=1e-6)


def test_an_unknown_skeleton_is_refused_with_what_is_missing(tmp_path, motion):
    names = MIXAMO | {"left_knee": "Bone07", "head": "Bone12"}
    with pytest.raises(
        InputError, match=r"no joint for head, left_knee; it has Hips, .*Bone07.*Names as in CMU"
    ):
        load_motion(write_bvh(tmp_path / "a.bvh", motion, names))


@pytest.mark.parametrize(("change", "text"), [
    (lambda t: t[: len(t) // 2], "cut off, it announces 12 frames"),
    (lambda t: t[:300], "not a whole BVH file"),
    (lambda t: t.replace("}", "", 1), "braces do not match"),
    (lambda t: t.replace("Frames: 12", "Frames: 1"), "1 frames of"),
    (lambda t: t.replace("HIERARCHY", "SKELETON"), "not a whole BVH file"),
    (lambda t: t.replace("OFFSET 0.0", "OFFSET zero", 1), "not a readable BVH file"),
    (lambda t: t.replace("OFFSET 0.0", "OFFSET nan", 1), "OFFSET holds nan"),
    (lambda t: t.replace("OFFSET 0.0", "OFFSET 1e300", 1), r"OFFSET holds 1e\+300"),
    (lambda t: t.replace("Frames: 12", "Frames: " + "9" * 5000), "cut off"),
    (lambda t: t.replace("Frames: 12", "Frames: -12"), "not a whole BVH file"),
    (lambda t: t.replace("Frames: 12", "Frames: twelve"), "not a whole BVH file"),
    (lambda t: re.sub("Frame Time: .*", "Frame Time: 0", t), "12 frames of 0.0 s"),
    (lambda t: re.sub("Frame Time: .*", "Frame Time: nan", t), "12 frames of nan s"),
    (lambda t: re.sub("Frame Time: .*", "Frame Time: inf", t), "fps is 0.0"),
    (lambda t: re.sub("Frame Time: .*", "Frame Time: 1e-9", t), "fps is"),
    (lambda t: re.sub("Frame Time: .*", "Frame Time: soon", t), "not a readable BVH file"),
    (lambda t: t.replace("CHANNELS 6", "CHANNELS 5", 1), "has 69 values for 68 channels"),
    (lambda t: t.replace("Xposition", "Xscale", 1), "a channel is called 'Xscale'"),
    (lambda t: re.sub(r"(?m)^\s*CHANNELS .*$", "", t), "has 69 values for 0 channels"),
    (lambda t: t.rstrip() + " 1 2 3\n", "frame 11 has 72 values for 69 channels"),
    (lambda t: t.rstrip().rpartition(" ")[0] + " inf\n", "frame 11 holds inf"),
    (lambda t: t.rstrip().rpartition(" ")[0] + " x\n", "frame 11: could not convert"),
    (lambda t: t.rstrip().rpartition("\n")[0] + "\x0c\n", "cut off, it announces 12 frames and holds 11"),
    (lambda t: t.replace("}", "} }", 1).replace("ROOT", "{ ROOT", 1), "not a readable BVH file"),
    (lambda t: t.replace("HIERARCHY", "HIERARCHY\n" + "{" * 5000 + "}" * 5000), "nested 5000 deep"),
    (lambda t: re.sub("OFFSET .*", "OFFSET 0 0 0", t), "different axes"),
])  # fmt: skip
def test_damaged_files_are_named_with_what_is_wrong(tmp_path, motion, change, text):
    path = write_bvh(tmp_path / "bad.bvh", motion, MIXAMO)
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=text) as caught:
        load_motion(path)
    assert "bad.bvh" in str(caught.value)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"Kaydara")
    with pytest.raises(InputError, match=r"\.npz or \.bvh"):
        load_motion(tmp_path / "a.fbx")
    with pytest.raises(InputError, match="no motion file in this folder"):
        sorted_sources([tmp_path])
    with pytest.raises(InputError, match="no such file"):
        load_motion(tmp_path / "none.bvh")
    (tmp_path / "binary.bvh").write_bytes(b"\xff\xfe\x00HIERARCHY")
    with pytest.raises(InputError, match="would be text"):
        load_motion(tmp_path / "binary.bvh")
