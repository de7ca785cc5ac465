"""Anchors from k-means, their vertices, and what they follow."""

import numpy as np

from imgtransfer.deformers.anchordef.anchors import initial_anchors, nearest, tight_anchors


def test_anchors_are_the_centres_of_clusters():
    generator = np.random.default_rng(0)
    centres = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5]], float)
    points = (centres[:, None] + 0.01 * generator.normal(size=(4, 20, 3))).reshape(-1, 3)
    anchors = initial_anchors(points, 4, seed=1)
    means = points.reshape(4, 20, 3).mean(1)
    order = [int(np.linalg.norm(means - anchor, axis=1).argmin()) for anchor in anchors]
    assert sorted(order) == [0, 1, 2, 3]
    np.testing.assert_allclose(anchors, means[order], atol=1e-12)
    np.testing.assert_array_equal(anchors, initial_anchors(points, 4, seed=1))


def test_nearest_targets_the_nearest_first():
    targets = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]], float)
    points = np.array([[0.9, 0, 0], [2.5, 0, 0]])
    np.testing.assert_array_equal(nearest(points, targets, 2), [[1, 0], [2, 1]])
    np.testing.assert_array_equal(nearest(points, targets, 1), [[1], [2]])
    assert nearest(points, targets, 8).shape == (2, 3)


def test_anchors_near_a_joint_are_tight():
    anchors = np.array([[0, 0, 0.1], [0, 0, 0.3], [1, 0, 0.2]])
    joints = np.array([[0, 0, 0], [1, 0, 0]], float)
    np.testing.assert_array_equal(tight_anchors(anchors, joints, 0.2), [True, False, True])
