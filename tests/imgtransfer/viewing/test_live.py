"""A garment predicted live, without a browser."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.bodies import AnnyShape
from imgtransfer.shipped import shipped_model
from imgtransfer.viewing.live import LiveModel, pose_of


def test_a_pose_is_predicted_whatever_was_shown_before() -> None:
    model = shipped_model("general")
    assert model is not None
    worn = LiveModel(model).worn("tshirt", AnnyShape(weight=0.8))
    first = worn.posed({"arms up": -50.0}, fused=False).now
    other = worn.posed({"arms up": 40.0}, fused=False).now
    again = worn.posed({"arms up": -50.0}, fused=False).now
    assert first.garment is not None
    assert other.garment is not None
    assert again.garment is not None
    np.testing.assert_array_equal(again.garment, first.garment)  # it was not moving
    assert np.abs(other.garment - first.garment).max() > 0.05  # metres: the sleeves follow the arms
    for frame in (first, other):
        assert frame.garment is not None
        assert np.median(cKDTree(frame.body).query(frame.garment)[0]) < 0.06


def test_poses_turn_the_joints_that_they_name() -> None:
    poses = pose_of({"knees": 90.0, "twist": 30.0})
    np.testing.assert_allclose(poses[0, 4], [np.pi / 2, 0, 0])  # the left knee
    np.testing.assert_allclose(poses[0, 5], [np.pi / 2, 0, 0])
    np.testing.assert_allclose(
        poses[0, 3] + poses[0, 6], [0, np.pi / 6, 0]
    )  # shared by two joints of the spine
    assert not pose_of({}).any()
