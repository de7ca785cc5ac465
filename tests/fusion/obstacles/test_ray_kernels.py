"""Rays out of boxes in boxes, whose winding numbers and exits are known."""

import numpy as np
import pytest
import torch
import trimesh

from fusion import BodySdf


def box(size, centre=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(extents=np.broadcast_to(size, 3).astype(float))
    mesh.apply_translation(centre)
    return mesh


def query(point, *meshes, band=None):
    body = trimesh.util.concatenate(meshes)
    sdf = BodySdf(body.faces, len(body.vertices), band_m=band)
    sdf.update(body.vertices)
    answer = sdf.query(torch.tensor(point).float().reshape(-1, 3))
    return answer.distance.numpy(), answer.direction.numpy(), answer.closest.numpy()


@pytest.mark.parametrize("inner", [1, 2, 5])
def test_from_within_boxes_in_a_box_the_way_out_is_through_the_outermost(inner):
    """However many the point is in at once: 0.3 m to the face at x = 1 and not 0.1 m to that of the inner box."""
    nested = [box(1.6 - 0.02 * k) for k in range(inner)]
    distance, direction, closest = query([0.7, 0.0, 0.0], box(2.0), *nested)
    np.testing.assert_allclose(distance, [-0.3], atol=1e-5)
    np.testing.assert_allclose(direction, [[1, 0, 0]], atol=1e-5)
    np.testing.assert_allclose(closest, [[1, 0, 0]], atol=1e-5)


def test_out_of_a_cross_of_two_bars_the_way_is_the_shorter_one():
    """Bars of 3 m along x and y, 1 and 0.8 m thick; at x = 0.9 a point is in the first one alone."""
    cross = box([3, 1, 1]), box([1, 3, 0.8])
    distance, direction, _ = query([0.9, 0.45, 0.0], *cross)
    np.testing.assert_allclose(distance, [-0.05], atol=1e-5)
    np.testing.assert_allclose(direction, [[0, 1, 0]], atol=1e-5)
    # In both, 5 cm below the top of the second one, which is inside the first: on to its top at z = 0.5.
    distance, direction, _ = query([0.1, 0.0, 0.35], *cross)
    np.testing.assert_allclose(distance, [-0.15], atol=1e-5)
    np.testing.assert_allclose(direction, [[0, 0, 1]], atol=1e-3)


def test_two_boxes_apart_do_not_count_for_each_other():
    """A ray may pass through the other box: in once, out once."""
    pair = box(1.0), box(1.0, (3.0, 0, 0))
    distance, *_ = query([[0.4, 0, 0], [1.5, 0, 0], [2.6, 0, 0], [-0.6, 0, 0]], *pair)
    np.testing.assert_allclose(distance, [-0.1, 1.0, -0.1, 0.1], atol=1e-5)


def test_deep_inside_a_band_is_no_limit():
    """Nothing is nearer than the band of 5 cm; a ray tells that the point is inside, and the depth is exact."""
    distance, direction, _ = query([[0.1, 0, 0], [0.9, 0, 0]], box(1.0), band=0.05)
    np.testing.assert_allclose(distance, [-0.4, 0.05], atol=1e-5)
    np.testing.assert_allclose(direction, [[1, 0, 0], [0, 0, 0]], atol=1e-5)


def test_a_scene_moved_aside_gives_the_same_distances():
    points = np.array([[0.7, 0.1, -0.2], [0.1, 0.48, 0.2], [0.95, 0.2, 0.3]])
    shift = np.array([5.0, -3.0, 2.0])
    want, found = (
        query(points + offset, box(2.0, offset), box(1.6, offset))[0] for offset in (np.zeros(3), shift)
    )
    np.testing.assert_allclose(found, want, atol=2e-5)
