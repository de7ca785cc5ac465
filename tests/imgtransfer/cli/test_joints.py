"""`simulate --joints FILE`: what BVH skeletons call SMPL's joints, where their names do not tell."""

import pytest

from imgtransfer.cli.main import main
from imgtransfer.motions.library import make_motion
from tests.helpers.amass_files import write_amass
from tests.helpers.bvh_files import MIXAMO, write_bvh


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = MIXAMO | {"left_knee": "Bone07", "head": "Top"}
    write_bvh(tmp_path / "robot.bvh", make_motion("walk", seconds=0.3), names)
    write_amass(tmp_path / "walk.npz")
    return tmp_path


def refused(capsys, *argv):
    assert main(["simulate", *argv, "--out", "set.zarr"]) == 2
    return capsys.readouterr().err


def test_joints_are_named_by_a_file(robot, capsys):
    assert "no joint for head, left_knee" in (said := refused(capsys, "robot.bvh"))
    assert "or --joints that says which they are" in said
    (robot / "joints.yaml").write_text("left_knee: Bone07\nhead: Top\n")
    said = refused(capsys, "robot.bvh", "--joints", "joints.yaml", "--clip", "none/none")
    assert "no clip matches (names none/none); there are tshirt/robot" in said  # so it was read


@pytest.mark.parametrize(("content", "text"), [
    ("knee: Bone07", "joints.yaml: joints: 'knee' is none of SMPL's joints, pelvis, left_hip"),
    ("left_knee: Bone7\nhead: Top", "robot.bvh: joints: left_knee is 'Bone7', which the skeleton lacks; it has Hips"),
    ("- left_knee", "joints.yaml: joints: "),
    ("left_knee: [a]", "joints.yaml: joints.left_knee: "),
    ("", "joints.yaml: "),
])  # fmt: skip
def test_wrong_files_are_named_with_what_is_wrong(robot, capsys, content, text):
    (robot / "joints.yaml").write_text(content)
    said = refused(capsys, "robot.bvh", "--joints", "joints.yaml")
    assert text in said
    assert said.rstrip().count("\n") == 0


def test_joints_go_with_bvh_files_and_are_said_once(robot, capsys):
    (robot / "joints.yaml").write_text("head: Top")
    assert "--joints goes with BVH files" in refused(capsys, "walk.npz", "--joints", "joints.yaml")
    assert "none.yaml" in refused(capsys, "robot.bvh", "--joints", "none.yaml")
    twice = refused(capsys, "robot.bvh", "--joints", "joints.yaml", "--set", "files.joints.head=Top")
    assert "--joints" in twice
    assert "files.joints" in twice
