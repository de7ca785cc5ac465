"""Seed points of the body and its parts."""

from dataclasses import replace

import numpy as np

from imgtransfer.deformers.motion_guided.seeds import body_parts, farthest_points, spacing
from tests.helpers.synthetic import tube, tube_clip


def test_farthest_points_of_a_strip_by_hand():
    # A strip of 5 by 2 vertices, 1 m by 0.1 m a cell: an end, the other end, then the middle.
    x, y = np.meshgrid(np.arange(5.0), [0, 0.1], indexing="ij")
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    a = 2 * np.arange(4)
    faces = np.concatenate([np.stack([a, a + 2, a + 3], -1), np.stack([a, a + 3, a + 1], -1)])
    taken = farthest_points(vertices, faces, 3)
    assert abs(vertices[taken[0], 0] - vertices[taken[1], 0]) == 4
    assert vertices[taken[2], 0] == 2


def test_distances_go_along_the_surface():
    # A strip folded back onto itself: its two ends are 1 cm apart in space, and far apart on it.
    x = np.concatenate([np.linspace(0, 1, 6), np.linspace(1, 0, 6)[1:]])
    z = np.repeat([0, 0.01], [6, 5])
    vertices = np.stack([np.repeat(x, 2), np.tile([0, 0.1], 11), np.repeat(z, 2)], -1)
    a = 2 * np.arange(10)
    faces = np.concatenate([np.stack([a, a + 2, a + 3], -1), np.stack([a, a + 3, a + 1], -1)])
    taken = farthest_points(vertices, faces, 3)
    assert taken[0] // 2 == 5  # the fold
    assert {taken[1] // 2, taken[2] // 2} == {0, 10}


def test_parts_that_no_edge_joins_each_get_a_point():
    vertices, faces = tube(0.1, 1.0, 4, 6, closed=False)
    both = np.vstack([vertices, vertices + np.float32(5)])
    taken = farthest_points(both, np.concatenate([faces, faces + len(vertices)]), 2)
    assert sorted(taken >= len(vertices)) == [False, True]


def test_no_more_points_than_vertices_with_an_edge():
    vertices, faces = tube(0.1, 1.0, 3, 5, closed=False)
    taken = farthest_points(np.concatenate([vertices, [[9, 9, 9]]]), faces, 100)
    assert sorted(taken) == list(range(15))


def test_parts_follow_joints():
    clip = tube_clip(2)
    low, high = int(clip.body.rest[:, 1].argmin()), int(clip.body.rest[:, 1].argmax())
    seeds = np.array([high, low, high])
    np.testing.assert_array_equal(body_parts(clip, seeds), [1, 0, 1])
    by_joint = replace(clip, skeleton=replace(clip.skeleton, blend_weights=None))
    np.testing.assert_array_equal(body_parts(by_joint, seeds), [1, 0, 1])
    np.testing.assert_array_equal(body_parts(clip, seeds[:1]), [0])
    bare = replace(by_joint, skeleton=replace(by_joint.skeleton, joints_rest=None))
    np.testing.assert_array_equal(body_parts(bare, seeds), [0, 0, 0])


def test_spacing_is_the_median_distance_to_the_nearest():
    assert spacing(np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0.0]])) == 1
    assert spacing(np.zeros((1, 3))) == 1
