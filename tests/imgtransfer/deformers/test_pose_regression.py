"""The regression against a plain loop, what it sees by hand, what it chooses, and that it can fit one clip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.lbs import Lbs, LbsConfig
from imgtransfer.deformers.pose_regression import PoseRegression, PoseRegressionConfig
from imgtransfer.deformers.pose_regression.features import before, pose_features
from imgtransfer.deformers.pose_regression.regression import KernelRegression
from imgtransfer.deformers.pose_regression.selection import choose
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip


def test_the_regression_is_the_plain_loop() -> None:
    rng = np.random.default_rng(0)
    seen, targets, asked = rng.normal(size=(7, 3)), rng.normal(size=(7, 2)), rng.normal(size=(4, 3))
    kernel = np.array([[np.exp(-((a - b) ** 2).sum()) for b in seen] for a in seen])
    mean = targets.mean(0)
    coefficients = np.linalg.inv(kernel + 0.1 * np.eye(7)) @ (targets - mean)
    wanted = np.zeros((4, 2))
    for t, x in enumerate(asked):
        wanted[t] = mean
        for support, coefficient in zip(seen, coefficients, strict=True):
            wanted[t] += coefficient * np.exp(-((x - support) ** 2).sum())
    np.testing.assert_allclose(KernelRegression.fit(seen, targets, 0.1)(asked), wanted, atol=1e-6)


def test_a_moment_before_is_a_time_and_not_a_number_of_frames() -> None:
    values = np.array([0.0, 10, 20, 30])
    np.testing.assert_allclose(before(values, 1.5), [0, 0, 5, 15])
    np.testing.assert_array_equal(before(values, 0), values)
    np.testing.assert_array_equal(before(values, 100), [0, 0, 0, 0])
    clip = tube_clip(9)
    every_second = with_arrays(clip.slice(slice(None, None, 2)), fps=15.0)
    twice = pose_features(clip, 4 / 30)
    np.testing.assert_allclose(pose_features(every_second, 4 / 30), twice[::2], atol=1e-12)


def test_features_are_turns_and_the_vertical() -> None:
    poses = np.zeros((1, 2, 3))
    poses[0, 0, 0] = np.pi / 2  # the root leans forwards: its own z axis points down, its y axis forwards
    poses[0, 1, 2] = np.pi / 2
    seen = pose_features(with_arrays(tube_clip(1), poses=poses), 0.1)
    np.testing.assert_allclose(seen[0, 0, 0], [0, 0, -1, 0, 0, 0, 0, 0, 0], atol=1e-7)
    np.testing.assert_allclose(seen[0, 1, 1], [0, -1, 0, 1, 0, 0, 0, 0, 1], atol=1e-7)


def test_heading_alone_is_not_seen() -> None:
    poses = np.zeros((2, 2, 3))
    poses[1, 0, 1] = 2.0
    seen = pose_features(with_arrays(tube_clip(2), poses=poses), 0)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-7)


def test_the_joint_that_counts_is_kept() -> None:
    rng = np.random.default_rng(1)
    features = rng.normal(size=(60, 4, 2, 9))
    targets = np.stack([np.sin(features[:, 2, 0, 0]), features[:, 2, 0, 1]], axis=1)
    choice = choose(features, targets, np.repeat([0, 1, 2], 20), joints=1, steps=80)
    assert choice.joints.tolist() == [2]
    now, earlier = choice.scales[0]
    assert now > 2 * earlier
    assert choice.error < 0.7 * np.sqrt((targets.var(axis=0)).sum())


def test_one_clip_is_fitted_to_a_millimetre_and_comes_back_from_its_tensors(tmp_path: Path) -> None:
    clip = tube_clip(24)
    method = PoseRegression(PoseRegressionConfig(steps=20))
    method.fit([clip], FitFolder(tmp_path))
    skinned = Lbs(LbsConfig())
    skinned.fit([clip], FitFolder(tmp_path))
    truth = clip.garment.vertices
    error, of_skinning = (
        1e3 * np.linalg.norm(one.predict(clip) - truth, axis=-1).mean() for one in (method, skinned)
    )
    assert error < 1.0  # mm
    assert of_skinning > 3.0
    again = PoseRegression(PoseRegressionConfig(steps=20))
    again.restore(method.tensors())
    np.testing.assert_array_equal(again.predict(clip), method.predict(clip))
    assert again.parameters() == method.parameters()


def test_tensors_of_other_shapes_are_refused(tmp_path: Path) -> None:
    method = PoseRegression(PoseRegressionConfig(steps=2))
    method.fit([tube_clip(5)], FitFolder(tmp_path))
    tensors = method.tensors()
    for key in ("scales", "support", "coefficients", "mean", "weights"):
        with pytest.raises(ValueError, match=r"shape|vertices"):
            method.restore(tensors | {key: tensors[key][:-1]})
    with pytest.raises(ValueError, match="joints"):
        method.restore(tensors | {"joints": -1 - tensors["joints"]})
    with pytest.raises(ValueError, match="int64"):
        method.restore(tensors | {"faces": tensors["faces"].to(torch.int32)})


def test_clips_that_it_cannot_see_are_refused(tmp_path: Path) -> None:
    method, clip = PoseRegression(PoseRegressionConfig(steps=2)), tube_clip(5)
    transforms = np.tile(np.eye(3, 4), (5, 2, 1, 1))
    without = with_arrays(clip, poses=None, joint_transforms=transforms)
    with pytest.raises(InputError, match="lacks poses"):
        method.fit([without], FitFolder(tmp_path))
    with pytest.raises(InputError, match="one frame"):
        method.fit([tube_clip(1)], FitFolder(tmp_path))
    three = with_arrays(clip, poses=np.zeros((5, 3, 3)), joint_transforms=transforms)
    with pytest.raises(InputError, match="3 joints in poses, and 2"):
        method.fit([clip, three], FitFolder(tmp_path))
    method.fit([three], FitFolder(tmp_path))
    method.joints = np.array([2])
    with pytest.raises(InputError, match="2 joints in poses"):
        method.predict(clip)
