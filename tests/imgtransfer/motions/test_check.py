from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.check import motion_faults
from imgtransfer.motions.kinds import KINDS
from imgtransfer.motions.library import make_motion
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.plan import plan
from render import InputError


def still(frames=10, **degrees):
    """A motion at 30 frames a second in which joints turn about x by (T,) degrees."""
    poses = np.zeros((frames, 22, 3))
    for joint, values in degrees.items():
        poses[:, JOINTS.index(joint), 0] = np.radians(values)
    return Motion(poses, np.zeros((frames, 3)), 30.0, "m")


@pytest.mark.parametrize("kind", KINDS)
def test_the_library_keeps_within_what_bodies_do(kind):
    assert motion_faults(make_motion(kind, seed=2, tempo=1.3, seconds=3)) == []


def test_a_joint_that_is_bent_too_far_is_named_with_the_time():
    motion = still(left_knee=np.linspace(0, 178, 10))
    assert motion_faults(motion) == ["left_knee is turned by 178° at 0.30 s, where bodies reach 170°"]


def test_a_flip_is_named_and_half_turns_are_measured_the_short_way():
    flip = still(right_shoulder=np.where(np.arange(10) < 5, 0.0, 120.0))
    assert motion_faults(flip) == [
        "right_shoulder turns by 3600° a second at 0.13 s, at most 2500 are allowed"
    ]
    assert motion_faults(flip, turning=4000) == []
    wrapped = still(pelvis=np.where(np.arange(10) < 5, 179.0, -179.0))  # two degrees apart
    assert motion_faults(wrapped) == []


def test_a_body_that_jumps_away_is_named_in_its_own_size():
    motion = still()
    motion.trans[5:, 2] = 0.5  # within a frame: 15 m/s
    assert motion_faults(motion) == ["the body moves at 15.0 m/s at 0.13 s, at most 12 are allowed"]
    assert motion_faults(replace(motion, leg_length=1.6)) == []  # a giant's half metre


def test_a_plan_leaves_such_files_out_and_says_so(tmp_path, caplog):
    for name, angle in (("good", 20.0), ("bad", 200.0)):
        poses = np.zeros((20, 66))
        poses[10:, 3 * JOINTS.index("neck")] = np.radians(angle)
        np.savez(tmp_path / f"{name}.npz", poses=poses, trans=np.zeros((20, 3)), mocap_framerate=30.0)
    tasks = plan(SimulateConfig(), [tmp_path])
    assert [task.motion.name for task in tasks] == ["good"]
    assert "left out" in (said := caplog.text)
    assert "bad.npz: neck is turned by" in said
    with pytest.raises(InputError, match="nothing to simulate"):
        plan(SimulateConfig(), [tmp_path / "bad.npz"])
