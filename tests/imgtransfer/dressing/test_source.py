"""What moves a body, read from the user's files."""

import re

import numpy as np
import pytest

from imgtransfer.dressing.source import open_source
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.config import SimulateConfig
from render import InputError
from tests.helpers import synthetic
from tests.helpers.amass_files import write_amass
from tests.helpers.import_examples import write_mdd, write_obj, write_pc2

CONFIG = SimulateConfig()


@pytest.fixture(scope="module")
def body():
    clip = synthetic.tube_clip(5)
    return clip.body


def test_a_motion_is_resampled_before_its_frames_are_chosen(tmp_path):
    path = write_amass(tmp_path / "a walk.npz")  # 61 frames at 60 a second
    source = open_source(path, CONFIG, frames=slice(2, 12, 4))
    assert isinstance(source.moved, Motion)
    assert source.moved.poses.shape == (31, 22, 3)
    assert list(source.frames) == [2, 6, 10]
    assert source.fps == 7.5
    assert source.name == "a-walk"


def test_a_single_frame_may_be_chosen(tmp_path):
    assert list(open_source(write_amass(tmp_path / "a.npz"), CONFIG, frames=slice(30, 31)).frames) == [30]


@pytest.mark.parametrize("frames", [slice(31, 40), slice(5, 5)])
def test_frames_that_are_not_there(tmp_path, frames):
    with pytest.raises(InputError, match=r"a\.npz has the frames 0 to 30"):
        open_source(write_amass(tmp_path / "a.npz"), CONFIG, frames=frames)


def broken(tmp_path):
    poses = np.zeros((61, 66))
    poses[40, 3 * 4] = 3.1  # a knee, for a 60th of a second
    return write_amass(tmp_path / "a.npz", poses=poses)


def test_a_motion_that_no_body_can_do_is_refused_unless_wanted(tmp_path, caplog):
    path = broken(tmp_path)
    with pytest.raises(InputError, match="left_knee") as refused:
        open_source(path, CONFIG)
    assert str(refused.value).startswith(f"{path}: ")
    assert "anyway=True" in str(refused.value)
    open_source(path, CONFIG, anyway=True)
    assert "left_knee" in caplog.text


def test_what_is_wrong_outside_the_chosen_frames_is_no_obstacle(tmp_path):
    open_source(broken(tmp_path), CONFIG, frames=slice(0, 15))
    open_source(broken(tmp_path), CONFIG, frames=slice(30, 31))
    with pytest.raises(InputError, match="from frame 10 on"):
        open_source(broken(tmp_path), CONFIG, frames=slice(10, 25))


def test_a_moving_body_is_told_in_every_form(tmp_path, body):
    for frame, vertices in enumerate(body.vertices):
        write_obj(tmp_path / f"plain/f_{frame:04d}.obj", vertices, body.faces)
        write_obj(tmp_path / f"walk/body/b_{frame:04d}.obj", vertices, body.faces)
    write_obj(tmp_path / "body_rest.obj", body.rest, body.faces)
    write_obj(tmp_path / "walk/body_rest.obj", body.rest, body.faces)
    (tmp_path / "caches").mkdir()
    write_pc2(tmp_path / "caches/body.pc2", body.vertices)
    write_mdd(tmp_path / "caches/other.mdd", body.vertices, 30.0)
    for name in ("plain", "walk", "walk/body/b_*.obj", "caches/body.pc2", "caches/other.mdd"):
        source = open_source(tmp_path / name, CONFIG, frames=slice(1, None))
        assert list(source.frames) == [1, 2, 3, 4], name
        opened = source.moved.open().sequence
        np.testing.assert_allclose(opened.mesh.vertices, body.rest, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(opened.vertices(), body.vertices, atol=1e-6, err_msg=name)


def test_without_a_rest_pose_the_first_frame_is_it(tmp_path, body, caplog):
    for frame, vertices in enumerate(body.vertices):
        write_obj(tmp_path / f"deep/er/plain/f_{frame:04d}.obj", vertices, body.faces)
    open_source(tmp_path / "deep/er/plain", CONFIG)
    assert "first frame is taken as the rest pose" in caplog.text


@pytest.mark.parametrize(
    ("name", "said"),
    [("none.npz", "no such file"), ("none", "no such file or folder"), ("notes.txt", "neither a motion nor")],
)
def test_what_is_neither_motion_nor_body(tmp_path, name, said):
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(InputError, match=re.escape(str(tmp_path / name)) + ".*" + said):
        open_source(tmp_path / name, CONFIG)


def test_a_folder_without_meshes(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty"):
        open_source(tmp_path / "empty", CONFIG)
