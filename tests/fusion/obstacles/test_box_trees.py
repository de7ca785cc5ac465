"""Trees of boxes: against all faces one by one."""

import numpy as np
import pytest
import torch
import trimesh

from fusion.obstacles import tree_kernels as kernels
from fusion.obstacles.box_trees import BoxTrees, _sorted
from fusion.warp_start import warp_module

wp = warp_module()


@wp.kernel(enable_backward=False)
def ask(
    trees: kernels.Trees,
    points: wp.array2d(dtype=wp.vec3),
    directions: wp.array2d(dtype=wp.vec3),
    farthest: float,
    found: wp.array3d(dtype=float),
):
    t, i = wp.tid()
    place = kernels.nearest_on(trees, t, points[t, i], farthest)
    found[t, i, 0] = float(place.face)
    if place.face >= 0:
        found[t, i, 1] = wp.length(place.at - points[t, i])
        u, v = place.u, place.v
        p = kernels.face_point(trees, t, place.face, 0) * u + kernels.face_point(trees, t, place.face, 1) * v
        at = p + kernels.face_point(trees, t, place.face, 2) * (1.0 - u - v)
        found[t, i, 2] = wp.length(at - place.at)
    found[t, i, 3] = float(kernels.winding_along(trees, t, points[t, i], directions[t, i]))


def asked(faces, poses, points, directions=None, farthest=10.0):
    """(T, P, 4): face, distance, how far weights are from the place, winding number; the tree is the first pose's."""
    poses, points = (np.asarray(values, np.float32) for values in (poses, points))
    directions = np.broadcast_to([0.3, 0.2, 0.9], points.shape) if directions is None else directions
    posed = torch.from_numpy(poses)
    trees = BoxTrees(np.asarray(faces, np.int64), poses[0], torch.device("cpu")).fit(posed)
    found = wp.zeros((*points.shape[:2], 4), dtype=float, device="cpu")
    vectors = [
        wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3, device="cpu")
        for values in (points, directions)
    ]
    wp.launch(ask, dim=points.shape[:2], inputs=[trees, *vectors, farthest, found], device="cpu")
    return found.numpy()


@pytest.mark.parametrize("count", [1, 7, 16, 130, 3000])
def test_the_nearest_place_is_that_of_all_faces_in_every_pose(count):
    """Triangles anywhere; the second pose has nothing to do with the first, for which the tree is made."""
    rng = np.random.default_rng(count)
    poses = rng.normal(size=(2, 3 * count, 3))
    poses[:, 1::3] = poses[:, ::3] + 0.2 * rng.normal(size=(2, count, 3))
    poses[:, 2::3] = poses[:, ::3] + 0.2 * rng.normal(size=(2, count, 3))
    faces, points = np.arange(3 * count).reshape(-1, 3), rng.normal(size=(2, 9, 3)).astype(np.float32)
    found = asked(faces, poses, points)
    for t, i in np.ndindex(2, 9):
        corners = poses[t].astype(np.float32).astype(np.float64)[faces]
        closest = trimesh.triangles.closest_point(corners, np.repeat(points[t, i][None], count, 0))
        distances = np.linalg.norm(closest - points[t, i], axis=1)
        assert found[t, i, 1] == pytest.approx(distances.min(), rel=1e-5)
        assert distances[int(found[t, i, 0])] == pytest.approx(distances.min(), rel=1e-5)
    assert found[..., 2].max() < 1e-5


def test_of_faces_as_near_the_first_is_taken_and_nothing_beyond_the_reach():
    box = trimesh.creation.box()
    points = np.array([[[0.9, 0.5, 0.5], [0.0, 0.0, 1.5], [3.0, 0.0, 0.0]]])
    found = asked(box.faces, box.vertices[None], points, farthest=1.25)
    corner = np.flatnonzero((box.vertices[box.faces] == 0.5).all(-1).any(1))
    assert found[0, :, 0].tolist()[0] == corner[0]
    assert found[0, :2, 1] == pytest.approx([0.4, 1.0])
    assert found[0, 2, 0] == -1


@pytest.mark.parametrize("turned", [1, -1])
def test_rays_through_corners_and_edges_count_once(turned):
    """From within a box along its axes, to its corners and to the middles of its edges; and from outside, in the same
    directions, past it and through it."""
    box = trimesh.creation.box()
    directions = np.array(
        [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
    )
    inside = asked(box.faces[:, ::turned], box.vertices[None], np.zeros((1, 26, 3)), directions[None])
    assert inside[0, :, 3].tolist() == [turned] * 26
    outside = asked(box.faces[:, ::turned], box.vertices[None], -2.0 * directions[None], directions[None])
    assert outside[0, :, 3].tolist() == [0] * 26


def test_winding_numbers_of_spheres_one_in_another():
    inner, outer = (trimesh.creation.icosphere(subdivisions=3, radius=radius) for radius in (0.5, 1.0))
    both = trimesh.util.concatenate([inner, outer])
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(1, 300, 3))
    points = rng.uniform(-1.2, 1.2, (1, 300, 3))
    radius = np.linalg.norm(points[0], axis=1)
    clear = (np.abs(radius - 0.5) > 0.02) & (np.abs(radius - 1) > 0.02)
    found = asked(both.faces, both.vertices[None], points, directions)[0, clear, 3]
    assert found.tolist() == ((radius < 0.5).astype(int) + (radius < 1))[clear].tolist()


def test_points_are_sorted_into_halves_of_halves():
    points = np.random.default_rng(0).normal(size=(37, 3)) * [1.0, 5.0, 1.0]
    order, start = _sorted(points, 3)
    assert sorted(order.tolist()) == list(range(37))
    assert np.diff(start).min() == 37 // 8
    assert np.diff(start).max() <= 37 // 8 + 1
    heights = points[order, 1]
    assert heights[: start[4]].max() <= heights[start[4] :].min()  # the longest side first
