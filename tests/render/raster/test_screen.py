"""Faces projected by hand: depth planes, faces edge-on, and running numbers."""

from dataclasses import replace

import numpy as np
import pytest

from render import Camera, Mesh
from render.cameras import perspective
from render.raster.screen import before_plane, expand, screen_faces

# At the origin, looking along -z: at 1 m away the image of 20 x 30 pixels is 2 m high and 3 m wide.
CAMERA = Camera("front", np.eye(4), perspective(np.array([1.5, 1.0]), near=0.1, far=100.0), (20, 30))


def test_places_in_the_image_by_hand():
    """y goes down; twice as far away, half as large: 10 pixels a metre at 1 m."""
    mesh = Mesh(np.array([[0.0, 0, -1], [1, 0, -1], [0, 1, -2]]), np.array([[0, 1, 2]]))
    faces = screen_faces(mesh, CAMERA)
    np.testing.assert_allclose(faces.corners, [[[15, 10], [25, 10], [15, 5]]])
    np.testing.assert_allclose(faces.nearest, [1.0])
    # 1 / depth is 1 at the first corner and falls by 0.5 over 5 pixels upwards.
    np.testing.assert_allclose(faces.plane, [[1, 0, 0.1]], atol=1e-12)
    depth = 1 / faces.reciprocal_depth(np.array([0, 0]), np.array([[20.0, 10], [15, 7.5]]))
    np.testing.assert_allclose(depth, [1, 4 / 3])


def test_the_plane_gives_the_depth_of_every_point_of_a_face():
    generator = np.random.default_rng(0)
    mesh = Mesh(generator.uniform(-1, 1, (9, 3)) - [0, 0, 3], np.arange(9).reshape(3, 3))
    faces = screen_faces(mesh, CAMERA)
    weights = generator.dirichlet(np.ones(3), (3, 50))
    points = np.einsum("fkc,fcd->fkd", weights, mesh.vertices[mesh.faces])
    pixels = CAMERA.project(points.reshape(-1, 3)).reshape(3, 50, 3)
    index = np.repeat(np.arange(3), 50).reshape(3, 50)
    np.testing.assert_allclose(1 / faces.reciprocal_depth(index, pixels[..., :2]), -points[..., 2])


def test_turning_a_face_round_or_its_corners_changes_nothing():
    mesh = Mesh(np.array([[0.0, 0, -1], [1, 0, -1], [0, 1, -2]]), np.array([[0, 1, 2]]))
    want = screen_faces(mesh, CAMERA)
    for corners in ([1, 2, 0], [2, 1, 0]):
        found = screen_faces(replace(mesh, faces=np.array([corners])), CAMERA)
        np.testing.assert_array_equal(found.plane, want.plane)
        np.testing.assert_array_equal(found.corners, want.corners)


def test_faces_edge_on_without_area_and_behind_are_left_out():
    vertices = np.array(
        [[0.0, 0, -1], [0, 0, -3], [0, 0.5, -2], [1, 1, -2], [0, 1, -2], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    )
    faces = np.array([[0, 1, 2], [3, 3, 4], [0, 3, 4], [5, 6, 7]])  # edge-on, no area, whole, behind
    assert screen_faces(Mesh(vertices, faces), CAMERA).ids.tolist() == [2]


def test_no_triangles_have_no_parts():
    owner, parts = before_plane(np.zeros((0, 3, 3)), 0.1)
    assert (owner.shape, parts.shape) == ((0,), (0, 3, 3))


@pytest.mark.parametrize("front", [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2)])
def test_what_is_cut_off_is_as_large_as_what_it_lacks(front):
    """Corners 1 m before and 1 m behind the plane: with one in front a quarter of the area is left, with two 3/4."""
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
    corners[:, 2] = [-2 if k in front else 0 for k in range(3)]
    owner, parts = before_plane(corners[None], 1.0)

    def area(triangles):
        edges = triangles[:, 1:, :2] - triangles[:, :1, :2]
        return np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).sum() / 2

    assert owner.tolist() == [0] * len(front)
    assert area(parts) == pytest.approx(3 * (0.25 if len(front) == 1 else 0.75))
    assert parts[..., 2].max() == -1


@pytest.mark.parametrize("counts", [[], [0], [3], [2, 0, 1, 0, 4], [0, 0, 5]])
def test_running_numbers_are_those_of_a_loop(counts):
    want = [(k, number) for k, count in enumerate(counts) for number in range(count)]
    owner, number = expand(np.array(counts, int))
    assert list(zip(owner.tolist(), number.tolist(), strict=True)) == want
