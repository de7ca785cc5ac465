"""Folders of motions as data sets are unpacked: searched, named apart, and what cannot be read left out."""

import numpy as np
import pytest

from imgtransfer.running.messages import as_flag
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.motion_config import FileMotions
from imgtransfer.simulation.planning.motion_files import read_motions
from imgtransfer.simulation.planning.sources import MotionFile, sorted_sources
from render import InputError
from render.options import options_named
from tests.helpers.amass_files import write_amass

LYING = np.zeros((61, 66))
LYING[:, 2] = np.pi / 2


def motion(folder, name, **changes):
    folder.mkdir(parents=True, exist_ok=True)
    return write_amass(folder / name, **changes)


def shape(folder):
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "shape.npz", betas=np.zeros(16), gender="female")


def read(*paths, **settings):
    return [motion.name for motion, _ in read_motions(sorted_sources(paths)[0], SimulateConfig(**settings))]


def test_a_subjects_folder_is_read_without_its_shape_with_one_note(tmp_path, caplog):
    motion(tmp_path / "subject", "walk_poses.npz")
    shape(tmp_path / "subject")
    assert read(tmp_path / "subject") == ["walk_poses"]
    assert caplog.messages == [
        f"note: 1 npz files without poses are passed over ({tmp_path / 'subject/shape.npz'})"
    ]


def test_folders_are_searched_and_names_keep_subjects_apart(tmp_path, caplog):
    for subject in ("01", "02"):
        motion(tmp_path / "AMASS/CMU" / subject, "walk_poses.npz")
        shape(tmp_path / "AMASS/CMU" / subject)
    motion(tmp_path / "AMASS/ACCAD/Female1 (a)", "A2 - Sway t2_stageii.npz")
    motion(tmp_path / "AMASS/.cache", "hidden.npz")
    (tmp_path / "AMASS/set.zarr").mkdir()
    np.savez(tmp_path / "AMASS/set.zarr/clip.npz", poses=np.zeros((2, 66)))
    (tmp_path / "AMASS/CMU/round").symlink_to(tmp_path / "AMASS")
    assert read(tmp_path / "AMASS") == [
        "ACCAD_Female1-a-_A2---Sway-t2_stageii",
        "CMU_01_walk_poses",
        "CMU_02_walk_poses",
    ]
    assert "2 npz files without poses" in caplog.text


def test_a_motion_that_cannot_be_read_is_left_out_and_named_with_a_flag_that_there_is(tmp_path, caplog):
    motion(tmp_path, "walk.npz")
    motion(tmp_path, "lie.npz", poses=LYING)
    (tmp_path / "broken.bvh").write_text("HIERARCHY\n")
    with options_named(as_flag):
        assert read(tmp_path) == ["walk"]
    said = caplog.text
    assert f"left out {tmp_path / 'lie.npz'}: the body lies" in said
    assert "say so by --set files.up_axis=y or --set files.up_axis=z" in said
    assert f"left out {tmp_path / 'broken.bvh'}: not a whole BVH file" in said
    # As many as there are, when nothing can be read.
    (tmp_path / "walk.npz").unlink()
    with pytest.raises(InputError, match=r"broken\.bvh: not a whole BVH file"):
        read(tmp_path)
    assert read(tmp_path, files=FileMotions(up_axis="y")) == ["lie"]


def test_a_file_given_by_name_is_never_passed_over(tmp_path):
    shape(tmp_path)
    with pytest.raises(InputError, match=r"shape\.npz: lacks poses, trans, mocap_framerate"):
        read(tmp_path / "shape.npz")
    with pytest.raises(InputError, match=r"shape\.npz: no poses in it, nor in any other file given"):
        read(tmp_path)


def test_splits_go_by_a_files_own_name_or_its_clips(tmp_path):
    motion(tmp_path / "a", "01_05_walk.npz")
    files = FileMotions(test=("01_05*",), validation=("a_*",))
    [(moved, stem)] = read_motions(sorted_sources([tmp_path])[0], SimulateConfig(files=files))
    assert files.split(moved.name, stem) == "test"
    assert files.split("a_02", "02") == "validation"


def test_a_named_file_is_called_by_its_name_alone(tmp_path):
    path = motion(tmp_path / "a b", "walk (1).npz")
    assert sorted_sources([path]) == ([MotionFile(path, "walk-1", listed=True)], [])


def test_files_that_were_read_alike_have_one_line_of_summary(tmp_path, caplog):
    motion(tmp_path, "a.npz")
    motion(tmp_path, "b.npz")
    motion(tmp_path, "c.npz", mocap_framerate=np.float64(120))
    lying = motion(tmp_path, "d.npz", poses=LYING)
    with caplog.at_level("INFO", logger="imgtransfer"):
        read(tmp_path)
    assert caplog.messages[0] == (
        f"motion summary: {tmp_path / 'a.npz'} and 2 more: 183 frames at 60, 120 a second; y up; in metres"
    )
    assert caplog.messages[1].startswith(f"left out {lying}: ")
