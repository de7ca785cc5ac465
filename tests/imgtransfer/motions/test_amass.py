import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.motions.files import load_motion, read_motion
from render import InputError
from tests.helpers.amass_files import write_amass


def test_it_reads_the_body_joints_and_resamples_by_time(tmp_path):
    motion = load_motion(write_amass(tmp_path / "a_clip.npz", leg_length=np.float32(0.83)), fps=30)
    assert motion.name == "a_clip"
    assert motion.poses.shape == (31, 22, 3)
    np.testing.assert_allclose(motion.poses[:, 18, 1], 0.8 * np.arange(31) / 30, atol=1e-6)
    np.testing.assert_allclose(motion.trans[:, 2], np.arange(31) / 30, atol=1e-9)
    assert motion.leg_length == pytest.approx(0.83)


def test_the_leg_length_is_optional_and_the_other_rate_name_is_read(tmp_path):
    path = write_amass(tmp_path / "b.npz", mocap_framerate=None, mocap_frame_rate=np.int64(60))
    motion = load_motion(path, fps=60)
    assert motion.leg_length is None
    assert len(motion.poses) == 61


@pytest.mark.parametrize(("changes", "text"), [
    ({"poses": None}, "lacks poses"),
    ({"mocap_framerate": None}, "lacks mocap_framerate"),
    ({"poses": np.zeros((61, 60))}, r"poses must have shape \(T, 66 or more\)"),
    ({"trans": np.zeros((60, 3))}, "trans must have shape"),
    ({"trans": np.full((61, 3), np.inf)}, "not finite"),
    ({"mocap_framerate": np.float64(0)}, "fps is 0"),
    ({"mocap_framerate": np.float64(np.nan)}, "fps is nan"),
    ({"mocap_framerate": np.float64(np.inf)}, "fps is inf"),
    ({"mocap_framerate": np.float64(-30)}, "fps is -30"),
    ({"mocap_framerate": np.float64(1e-300)}, "fps is 1e-300"),
    ({"mocap_framerate": np.float64(0.01), "poses": np.zeros((99, 66)), "trans": np.zeros((99, 3))},
     "is the frame rate right"),
    ({"mocap_framerate": np.zeros(2)}, "must be one number"),
    ({"mocap_framerate": np.array("fast")}, "must hold numbers"),
    ({"poses": np.float64(1)}, r"poses must have shape .* found \(\)"),
    ({"poses": np.full((61, 66), 1e300)}, "beyond ±1000 rad"),
    ({"trans": np.full((61, 3), 1e300)}, r"beyond ±10000 m"),
    ({"leg_length": np.float64(np.inf)}, "leg_length"),
    ({"leg_length": np.float64(1e-300)}, "leg_length"),
    ({"leg_length": np.float64(-1)}, "leg_length"),
    ({"poses": np.array([["x"] * 66] * 61)}, "must hold numbers"),
])  # fmt: skip
def test_bad_files_are_named_with_what_is_wrong(tmp_path, changes, text):
    path = write_amass(tmp_path / "bad.npz", **changes)
    with pytest.raises(InputError, match=text) as caught:
        load_motion(path)
    assert "bad" in str(caught.value)


def test_missing_and_foreign_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_motion(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("not an npz")
    with pytest.raises(InputError, match="not a readable npz"):
        load_motion(tmp_path / "text.npz")
    np.savez(tmp_path / "pickle.npz", poses=np.array([{}], dtype=object), trans=0, mocap_framerate=30)
    with pytest.raises(InputError, match="poses is not a readable plain array"):
        load_motion(tmp_path / "pickle.npz")


@pytest.mark.parametrize("up_axis", ["auto", "z"])
def test_files_with_z_up_are_turned(tmp_path, up_axis):
    ours = load_motion(write_amass(tmp_path / "y.npz"))
    turn = Rotation.from_euler("x", 90, degrees=True)  # y up to z up
    poses = np.zeros((61, 156))
    poses[:, 3 * 18 + 1] = 0.8 * np.arange(61) / 60
    poses[:, :3] = turn.as_rotvec()
    trans = turn.apply(np.stack([np.zeros(61), np.full(61, 0.9), np.arange(61) / 60], axis=1))
    read = load_motion(write_amass(tmp_path / "z.npz", poses=poses, trans=trans), up_axis=up_axis)
    np.testing.assert_allclose(read.poses, ours.poses, atol=1e-6)
    np.testing.assert_allclose(read.trans, ours.trans, atol=1e-6)
    assert np.abs(load_motion(tmp_path / "z.npz", up_axis="y").poses - ours.poses).max() > 1


def test_a_body_that_lies_shows_no_up_axis(tmp_path):
    poses = np.zeros((61, 66))
    poses[:, 2] = np.pi / 2  # on its right side
    path = write_amass(tmp_path / "lying.npz", poses=poses)
    with pytest.raises(InputError, match="up_axis"):
        load_motion(path)
    assert len(load_motion(path, up_axis="y").poses) == 31


def test_files_of_smpl_x_are_read_and_other_models_refused(tmp_path):
    ours = load_motion(write_amass(tmp_path / "a.npz"))
    named = {"mocap_framerate": None, "mocap_frame_rate": np.float64(60), "gender": np.array("neutral")}
    columns = np.zeros((61, 165))
    columns[:, 3 * 18 + 1] = 0.8 * np.arange(61) / 60
    path = write_amass(
        tmp_path / "a_stageii.npz", poses=columns, surface_model_type=np.array("smplx"), **named
    )
    np.testing.assert_allclose(load_motion(path).poses, ours.poses, atol=1e-6)
    parts = {"poses": None, "root_orient": columns[:, :3], "pose_body": columns[:, 3:66]}
    np.testing.assert_allclose(
        load_motion(write_amass(tmp_path / "b.npz", **parts)).poses, ours.poses, atol=1e-6
    )
    with pytest.raises(InputError, match=r"root_orient and pose_body .* found \(61, 3\) and \(60, 63\)"):
        load_motion(write_amass(tmp_path / "c.npz", **parts | {"pose_body": columns[:60, 3:66]}))
    with pytest.raises(InputError, match="surface_model_type is 'animal_dog'; motions of smpl, smplh"):
        load_motion(write_amass(tmp_path / "dog.npz", surface_model_type=np.array("animal_dog")))


def test_the_summary_names_the_axis_that_is_up(tmp_path):
    summary = read_motion(write_amass(tmp_path / "a.npz"))[1]
    assert str(summary) == f"{tmp_path / 'a.npz'}: 61 frames at 60 a second; y up; in metres"
