from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.data.canonical import root_frames
from imgtransfer.deformers.common.body_motion import body_motion, joint_features, root_features
from imgtransfer.deformers.common.rates import at_frames, sample_times
from imgtransfer.deformers.common.rotations import mean_rotation, rotation_matrices, six_numbers
from imgtransfer.deformers.common.windows import Windows, warmed_up
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.moves import turned


def motion_of(clip):
    return body_motion(clip, root_frames(clip, "root"))


def test_six_numbers_of_a_quarter_turn():
    quarter = np.array([[0, 0, np.pi / 2]])  # x becomes y, y becomes -x
    np.testing.assert_allclose(six_numbers(quarter), [[0, 1, 0, -1, 0, 0]], atol=1e-7)


def test_rotation_matrices_are_scipys_and_have_a_gradient_at_zero():
    vectors = np.random.default_rng(0).normal(0, 1.5, (7, 3))
    vectors[0] = 0
    vectors[1] = [1e-5, 0, 0]
    got = rotation_matrices(torch.from_numpy(vectors))
    np.testing.assert_allclose(got, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-9)
    still = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    rotation_matrices(still)[1, 0].backward()
    assert still.grad.tolist() == [0, 0, 1]
    some = torch.tensor([0.3, -0.2, 0.9], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(rotation_matrices, (some,))


def test_mean_rotation_of_turns_either_way_is_none():
    turns = Rotation.from_rotvec([[0, 0.4, 0], [0, -0.4, 0]]).as_matrix()
    np.testing.assert_allclose(mean_rotation(turns), np.eye(3), atol=1e-12)


def test_root_features_by_hand():
    clip = tube_clip(4)
    features = root_features(motion_of(clip))
    np.testing.assert_allclose(features[:, :3], [[0, 1, 0]] * 4, atol=1e-6)  # it stays upright
    np.testing.assert_allclose(features[:, 6:], [[0, 1.5, 0]] * 4, atol=1e-4)  # and turns by 1.5 rad a second
    speed = np.linalg.norm(features[:, 3:6], axis=1)
    np.testing.assert_allclose(speed, np.hypot(0.3, 0.8), atol=0.02)


def test_one_frame_has_no_velocity():
    features = root_features(motion_of(tube_clip(4).slice(slice(2, 3))))
    assert features[:, 3:].tolist() == [[0] * 6]


def test_features_stay_when_a_clip_is_turned_about_the_vertical_and_moved():
    clip = tube_clip(5)
    one, other = motion_of(clip), motion_of(turned(clip))
    np.testing.assert_allclose(root_features(one), root_features(other), atol=1e-5)
    np.testing.assert_allclose(joint_features(one), joint_features(other), atol=1e-6)


def test_a_clip_without_poses_is_refused_in_one_line():
    bare = with_arrays(tube_clip(3), poses=None, trans=None, joints_rest=None, parents=None)
    with pytest.raises(InputError, match=r"tube/bend: has no poses \(T, J, 3\)"):
        motion_of(bare)


def test_a_motion_at_twice_and_half_the_rate():
    clip = tube_clip(9)
    motion = motion_of(clip)
    double = motion.at(60.0)
    assert len(double) == 17
    np.testing.assert_allclose(double.joints[::2], motion.joints, atol=1e-9)
    np.testing.assert_allclose(double.root[::2], motion.root, atol=1e-9)
    np.testing.assert_allclose(double.place[1], (motion.place[0] + motion.place[1]) / 2, atol=1e-12)
    half = double.at(30.0)
    np.testing.assert_allclose(half.joints, motion.joints, atol=1e-9)
    np.testing.assert_allclose(half.place, motion.place, atol=1e-12)


@pytest.mark.parametrize(
    ("frames", "fps", "sampled"), [(7, 30, 30), (7, 60, 30), (8, 60, 30), (5, 24, 50), (1, 30, 24)]
)
def test_what_is_linear_in_time_survives_another_rate(frames, fps, sampled):
    times = sample_times(frames, fps, sampled)
    assert times[-1] == pytest.approx((frames - 1) / fps)
    got = at_frames(times[:, None] * [2.0, -1.0], frames, fps, sampled)
    np.testing.assert_allclose(got, np.arange(frames)[:, None] / fps * [2.0, -1.0], atol=1e-9)


def test_a_clip_of_hours_is_refused_in_one_line():
    with pytest.raises(InputError, match="is the clip's frame rate right"):
        sample_times(1000, 0.01, 30)


def test_windows_of_clips_by_hand():
    batch = Windows([3, 8], warm_up=2, length=4).draw(64, np.random.default_rng(0))
    rows = {tuple(row) for row in batch.frames.tolist()}
    assert (0, 0, 0, 1, 2, 2) in rows  # before the short clip its first frame, after it its last
    assert rows - {(0, 0, 0, 1, 2, 2)} <= {
        tuple(np.clip(np.arange(start - 2, start + 4), 3, 10)) for start in range(3, 8)
    }
    short = batch.frames[:, -1] == 2
    assert batch.counted[short].tolist() == [[False, False, True, True, True, False]] * int(short.sum())
    assert batch.counted[~short].tolist() == [[False, False, *[True] * 4]] * int((~short).sum())


def test_warmed_up_begins_with_the_first_frame():
    assert warmed_up(torch.tensor([[1.0], [2.0]]), 2).tolist() == [[1], [1], [1], [2]]


def test_resampling_leaves_a_turn_about_the_vertical_alone():
    clip = replace(tube_clip(5), fps=25.0)
    at = motion_of(clip).at(30.0)
    angle = Rotation.from_matrix(at.root).as_rotvec()[:, 1]
    steps = np.diff(angle[:-1])
    np.testing.assert_allclose(steps, steps[0], atol=1e-6)
