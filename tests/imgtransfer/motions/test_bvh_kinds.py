"""BVH files as other tools write them: joints along their bones, roots above the hips, other axes, rates."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import INDEX, JOINTS, global_rotations, segment_direction
from imgtransfer.motions.files import load_motion, read_motion
from imgtransfer.motions.library import make_motion
from render import InputError
from tests.helpers.bvh_files import (
    MIXAMO,
    NAMINGS,
    Z_UP,
    along_bones,
    along_bones_mirrored,
    offsets,
    write_bvh,
)
from tests.helpers.paths import ROOT

CASES = ROOT / "tests/data/cases/bvh"
UNIT = 0.8 / 82  # metres of the cases' centimetres: their legs of 42 and 40 are read as 0.8 m


def directions(motion, joint, segment):
    """(T, 3) where a left segment points."""
    return global_rotations(motion.poses)[:, INDEX[joint]] @ segment_direction(segment, "left")


@pytest.mark.parametrize("name", ["plain", "reference_root", "zup_world"])
def test_paths_in_any_joint_above_the_hips_and_worlds_with_z_up_are_the_same_walk(name):
    motion = load_motion(CASES / f"{name}.bvh")
    assert len(motion.poses) == 31
    assert motion.fps == 30
    # 92 cm high, and 4 cm a frame forward: 120 in the last.
    np.testing.assert_allclose(motion.trans[:, 1], 92 * UNIT)
    np.testing.assert_allclose(motion.trans[:, 2], 4 * np.arange(31) * UNIT, atol=1e-9)
    np.testing.assert_allclose(motion.trans[:, 0], 0, atol=1e-9)
    np.testing.assert_allclose(motion.poses[:, 0], 0, atol=1e-9)
    np.testing.assert_allclose(directions(motion, "left_hip", "thigh"), [[0, -1, 0]] * 31, atol=1e-9)


def test_joints_along_their_bones_stand():
    motion = load_motion(CASES / "oriented_joints.bvh")
    turned = global_rotations(motion.poses)
    assert len(motion.poses) == 31
    np.testing.assert_allclose(motion.trans[0], [0, 92 * 0.8 / 84, 0], atol=1e-9)  # legs of 43 and 41
    for joint in ("pelvis", "spine3", "head", "left_collar", "left_ankle", "right_foot"):
        np.testing.assert_allclose(turned[:, INDEX[joint]], [np.eye(3)] * 31, atol=1e-9)
    np.testing.assert_allclose(directions(motion, "left_hip", "thigh"), [[0, -1, 0]] * 31, atol=1e-9)
    np.testing.assert_allclose(directions(motion, "left_elbow", "forearm"), [[1, 0, 0]] * 31, atol=1e-9)


@pytest.mark.parametrize("kind", ["walk", "kick", "reach"])
@pytest.mark.parametrize(("oriented", "order"), [(along_bones, "ZYX"), (along_bones_mirrored, "ZXY")])
def test_a_moving_skeleton_of_joints_along_their_bones_gives_back_its_limbs_and_twists(
    tmp_path, kind, oriented, order
):
    motion = make_motion(kind, seed=2, seconds=1.0)
    read, summary = read_motion(
        write_bvh(tmp_path / "a.bvh", motion, MIXAMO, oriented=oriented(), order=order)
    )
    assert "joints along their bones" in str(summary)
    theirs, ours = global_rotations(motion.poses), global_rotations(read.poses)
    angle = Rotation.from_matrix((np.swapaxes(theirs, 2, 3) @ ours).reshape(-1, 3, 3)).magnitude()
    worst = dict(zip(JOINTS, np.degrees(angle.reshape(len(ours), 22)).max(axis=0), strict=True))
    # What the foot does in the frame in which it is flattest is taken for none: 2.4 degrees at most here.
    feet = {f"{side}_{joint}" for side in ("left", "right") for joint in ("ankle", "foot")}
    assert max(worst[joint] for joint in JOINTS if joint not in feet) < 0.01
    assert max(worst[joint] for joint in feet) < 3
    np.testing.assert_allclose(read.trans, motion.trans, atol=1e-4)


def test_joints_along_their_bones_in_a_world_with_z_up_stand_too(tmp_path):
    motion = make_motion("walk", seed=2, seconds=1.0)
    y_up = load_motion(write_bvh(tmp_path / "y.bvh", motion, MIXAMO, oriented=along_bones()))
    z_up = load_motion(write_bvh(tmp_path / "z.bvh", motion, MIXAMO, oriented=along_bones(), world=Z_UP))
    np.testing.assert_allclose(global_rotations(z_up.poses), global_rotations(y_up.poses), atol=1e-5)
    np.testing.assert_allclose(z_up.trans, y_up.trans, atol=1e-5)


@pytest.mark.parametrize("axes", [np.eye(3), Z_UP])
def test_the_world_may_have_another_axis_up_than_the_skeleton(tmp_path, axes):
    motion = make_motion("walk", seed=4, seconds=1.0)
    world = Z_UP if axes is not Z_UP else Z_UP.T
    read, summary = read_motion(write_bvh(tmp_path / "a.bvh", motion, MIXAMO, axes=axes, world=world))
    np.testing.assert_allclose(global_rotations(read.poses), global_rotations(motion.poses), atol=2e-5)
    np.testing.assert_allclose(read.trans, motion.trans, atol=1e-4)
    assert summary.up_axis == ("z" if axes is not Z_UP else "y")


def lying(tmp_path, *, height, along=0.0):
    """Somebody on their belly, the head towards +z, in a world with y up: a z-up world's standing body looks so."""
    motion = make_motion("walk", seed=4, seconds=0.3)
    poses, trans = motion.poses.copy(), motion.trans.copy()
    poses[:, 0] = [np.pi / 2, 0, 0]
    trans[:] = [0, height, along]
    motion = type(motion)(poses, trans, motion.fps, motion.name, motion.leg_length)
    return write_bvh(tmp_path / "lying.bvh", motion, MIXAMO)


def test_a_body_that_lies_on_the_floor_keeps_lying(tmp_path):
    motion, summary = read_motion(lying(tmp_path, height=0.1, along=3.0))
    assert summary.up_axis == "y"
    np.testing.assert_allclose(motion.poses[:, 0], [[np.pi / 2, 0, 0]] * len(motion.poses), atol=1e-5)


def test_a_body_that_may_stand_or_lie_is_refused_with_the_flag_that_tells(tmp_path):
    path = lying(tmp_path, height=0.0, along=0.0)
    with pytest.raises(InputError, match=r"lying\.bvh: .* say so by up_axis='y' or up_axis='z'"):
        load_motion(path)
    assert np.abs(load_motion(path, up_axis="z").poses[:, 0]).max() < 1e-5
    assert load_motion(path, up_axis="y").poses[0, 0, 0] == pytest.approx(np.pi / 2)


def test_a_path_may_be_in_the_root_and_in_the_hips_at_once(tmp_path):
    text = (CASES / "reference_root.bvh").read_text()
    head, _, frames = text.partition("Frame Time: 0.03333333\n")
    moved = []
    for line in frames.splitlines():
        values = line.split()
        values[0], values[4] = "10", "90"  # the root 10 to the left, turned by 90 degrees about y
        moved.append(" ".join(values))
    path = tmp_path / "a.bvh"
    path.write_text(head + "Frame Time: 0.03333333\n" + "\n".join(moved))
    motion = load_motion(path)
    # (0, 92, 120) turned about y is (120, 92, 0).
    np.testing.assert_allclose(motion.trans[-1], np.array([130, 92, 0]) * UNIT, atol=1e-9)
    np.testing.assert_allclose(motion.poses[-1, 0], [0, np.pi / 2, 0], atol=1e-9)


@pytest.mark.parametrize("written", ["0.03333333", "0.033333", "0.0333", "0.033", "3.3333e-2", ".0333333"])
def test_every_frame_of_a_file_at_thirty_a_second_is_read_as_it_is(tmp_path, written):
    text = (CASES / "plain.bvh").read_text()
    path = tmp_path / "a.bvh"
    path.write_text(re.sub("Frame Time: .*", f"Frame Time: {written}", text))
    motion, summary = read_motion(path)
    assert (len(motion.poses), motion.fps, summary.frames) == (31, 30.0, 31)
    np.testing.assert_array_equal(motion.trans, load_motion(CASES / "plain.bvh").trans)


def test_two_frames_are_a_motion_and_at_a_lower_rate_a_message(tmp_path):
    head, _, frames = (CASES / "plain.bvh").read_text().partition("Frames: 31")
    path = tmp_path / "a.bvh"
    path.write_text(head + "Frames: 2" + frames)
    assert len(load_motion(path).poses) == 2
    with pytest.raises(InputError, match=r"a\.bvh: 2 frames at 30 a second .* less than one frame at 24"):
        load_motion(path, fps=24)


def encoded(text, encoding, mark=b""):
    return mark + text.encode(encoding)


@pytest.mark.parametrize(("encoding", "mark", "joint"), [
    ("utf-8", b"\xef\xbb\xbf", "Hips"),
    ("utf-16-le", b"\xff\xfe", "Hips"),
    ("utf-16-be", b"\xfe\xff", "Hips"),
    ("utf-8", b"", "腰"),
    ("shift-jis", b"", "ソ表"),  # whose second bytes are a backslash
    ("gbk", b"", "脏}"),
])  # fmt: skip
def test_marks_encodings_and_foreign_names_are_read(tmp_path, encoding, mark, joint):
    path = tmp_path / "a.bvh"
    text = (CASES / "plain.bvh").read_text().replace("Hips", joint)
    path.write_bytes(encoded(text, encoding, mark))
    np.testing.assert_array_equal(load_motion(path).trans, load_motion(CASES / "plain.bvh").trans)


@pytest.mark.parametrize("change", [
    lambda t: t.replace("\n", "\r\n"),
    lambda t: t.replace("\n", "\r"),
    lambda t: re.sub(r"(ROOT|JOINT) (\w+)\n\s*{", r"\1 \2 {", t),
    lambda t: t.replace("Xposition Yposition Zposition", "XPOSITION YPOSITION ZPOSITION").replace("OFFSET", "Offset"),
    lambda t: t.replace("Hips", "Hips  ").replace("Frames:", "FRAMES :").replace("Frame Time:", "Frame Time:\t"),
    lambda t: t.replace(" 92 ", " 92\n", 31),  # a frame over two lines
    lambda t: t.rstrip("\n"),
    lambda t: t.replace("JOINT Spine\n", "\n\nJOINT Lower Back (main)\n"),
], ids=["dos", "mac", "brace", "case", "spaces", "wrapped", "no end", "words"])  # fmt: skip
def test_other_spellings_of_a_file_are_the_same_motion(tmp_path, change):
    path = tmp_path / "a.bvh"
    path.write_bytes(change((CASES / "plain.bvh").read_text()).encode())
    read, plain = load_motion(path), load_motion(CASES / "plain.bvh")
    np.testing.assert_array_equal(read.trans, plain.trans)
    np.testing.assert_array_equal(read.poses, plain.poses)


def test_joints_that_names_do_not_tell_are_given(tmp_path):
    motion = make_motion("mixed", seed=4, seconds=0.4)
    names = MIXAMO | {"left_knee": "Bone07", "head": "Top", "spine3": "Bone03"}
    path = write_bvh(tmp_path / "a.bvh", motion, names)
    given = {"left_knee": "Bone07", "head": "Top"}
    read, summary = read_motion(path, joints=given)
    np.testing.assert_allclose(global_rotations(read.poses), global_rotations(motion.poses), atol=2e-5)
    assert "joints by name, left_knee, head as given: " in str(summary)
    assert "left_knee = Bone07" in str(summary)
    with pytest.raises(
        InputError, match=r"a\.bvh: joints: head is 'Topp', which the skeleton lacks; it has Hips"
    ):
        load_motion(path, joints=given | {"head": "Topp"})
    with pytest.raises(InputError, match="both left_knee and head are 'Top'"):
        load_motion(path, joints={"left_knee": "Top", "head": "Top"})
    with pytest.raises(InputError, match="left_knee was taken to be Top, which does not hang from LeftUpLeg"):
        load_motion(path, joints={"left_knee": "Top", "head": "Neck"})


def two_people(tmp_path, second):
    text = (CASES / "plain.bvh").read_text()
    hierarchy, _, motion = text.partition("MOTION\n")
    root = hierarchy.partition("HIERARCHY\n")[2]
    frames = [line + " " + line for line in motion.splitlines()[2:]]
    path = tmp_path / "two.bvh"
    other = second(root)
    path.write_text(
        "\n".join([hierarchy.rstrip(), other.rstrip(), "MOTION", "Frames: 31", "Frame Time: 0.0333", *frames])
    )
    return path


def test_of_several_roots_the_one_with_a_body_is_read_and_two_bodies_are_refused(tmp_path):
    prop = two_people(tmp_path, lambda root: re.sub(r"(ROOT|JOINT) (\w+)", r"\1 Prop_\2_x", root))
    np.testing.assert_array_equal(load_motion(prop).trans, load_motion(CASES / "plain.bvh").trans)
    twice = two_people(tmp_path, lambda root: root.replace("Hips", "Hips2"))
    with pytest.raises(InputError, match="holds 2 bodies, under the roots Hips, Hips2"):
        load_motion(twice)


def test_the_summary_says_what_was_taken():
    said = str(read_motion(CASES / "zup_world.bvh")[1])
    assert (
        "zup_world.bvh: 31 frames at 30 a second; z up; a unit is 0.009756 m; rest pose of the file; " in said
    )
    assert "joints by name: pelvis = Hips, left_hip = LeftUpLeg" in said


def test_hanging_arms_and_t_poses_at_rest_are_no_joints_along_their_bones(tmp_path):
    motion = make_motion("mixed", seed=4, seconds=0.4)
    for name, rest in (("t", offsets()), ("a", offsets(arms_down=True))):
        summary = read_motion(write_bvh(tmp_path / f"{name}.bvh", motion, NAMINGS["cmu"], rest=rest))[1]
        assert summary.rest == "rest pose of the file"


def test_a_root_without_positions_and_lines_behind_the_last_frame_are_said(tmp_path, caplog):
    file = write_bvh(tmp_path / "walk.bvh", make_motion("walk", seed=1, seconds=0.3), NAMINGS["cmu"])
    lines = file.read_text().splitlines()
    _, summary = read_motion(file)
    assert "its place" not in str(summary)
    first = lines.index("MOTION") + 3
    in_place = [
        line.replace("CHANNELS 6 Xposition Yposition Zposition", "CHANNELS 3") for line in lines[:first]
    ]
    in_place += [line.split(" ", 3)[3] for line in lines[first:]]
    file.write_text("\n".join([*in_place, *in_place[-2:], ""]))
    with caplog.at_level("WARNING"):
        motion, summary = read_motion(file)
    assert str(summary.rest).endswith("no position channels down to the hips: the body stays in its place")
    assert len(motion.poses) == len(lines) - first
    assert (
        f"walk.bvh: 2 lines follow the {len(motion.poses)} frames that it announces, and are left out"
        in caplog.text
    )
