"""Motion files are known by their suffix, however it is written."""

import pytest

from imgtransfer.motions.files import load_motion
from imgtransfer.motions.library import make_motion
from render import InputError
from tests.helpers.amass_files import write_amass
from tests.helpers.bvh_files import NAMINGS, write_bvh


def test_either_kind_is_read_at_the_wanted_rate(tmp_path):
    bvh = write_bvh(tmp_path / "walk.BVH", make_motion("walk", seconds=1.0), NAMINGS["mixamo"])
    npz = write_amass(tmp_path / "bend.npz")
    for path, name, seconds in ((bvh, "walk", 29 / 30), (npz, "bend", 1.0)):
        motion = load_motion(path, fps=15)
        assert motion.name == name
        assert motion.fps == 15
        assert len(motion.poses) == int(seconds * 15) + 1
        assert len(load_motion(str(path)).poses) == round(seconds * 30) + 1  # 30 a second unless it is said


@pytest.mark.parametrize("name", ["walk.fbx", "walk", "walk.bvh.zip", ".npz"])
def test_other_suffixes_are_refused_before_the_file_is_looked_for(name):
    with pytest.raises(InputError, match=r"a motion file is wanted, \.npz or \.bvh"):
        load_motion(name)
