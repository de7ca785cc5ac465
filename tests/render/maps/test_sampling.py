"""Weights that images are read with at vertices, by hand and by what they must not do."""

import numpy as np
import pytest
import torch

from render import Camera, Mesh, TemplateImager
from render.cameras import perspective
from render.maps.sampling import _affine_correction, _plain_weights, _slopes, _Window, sampling
from tests.helpers.example_meshes import sphere, two_quads


def window(offset, position=None, usable=True):
    """Pixels at `offset` (K, 2) from one vertex."""
    offset = np.array([offset], float)
    count = offset.shape[1]
    return _Window(
        index=np.arange(count)[None],
        usable=np.broadcast_to(usable, (1, count)),
        offset=offset,
        position=np.zeros((1, count, 3)) if position is None else np.array([position], float),
        footprint=np.ones((1, 1)),
    )


FOUR = [[-0.25, -0.5], [0.75, -0.5], [-0.25, 0.5], [0.75, 0.5]]


def test_four_neighbours_are_weighted_bilinearly():
    pixels = window(FOUR)
    np.testing.assert_allclose(_plain_weights(pixels, pixels.usable), [[0.375, 0.125, 0.375, 0.125]])


def test_those_that_cannot_be_used_leave_theirs_to_the_others():
    pixels = window(FOUR)
    found = _plain_weights(pixels, np.array([[True, True, False, False]]))
    np.testing.assert_allclose(found, [[0.75, 0.25, 0, 0]])


@pytest.mark.parametrize(
    ("offsets", "want"),
    [
        ([[-2, 0], [0, 1.5], [2, 2]], [0, 1, 0]),  # none next to it: the nearest of them
        ([[-2, 0], [3.1, 0], [0, 9]], [1, 0, 0]),
        ([[3.1, 0], [0, 9]], [0, 0]),  # none within 3 pixels
        ([[0.999, 0.99], [0, 1.2]], [0, 1]),  # the first has a hundred-thousandth, which is rounding
    ],
)
def test_where_no_neighbour_shows_the_surface_the_nearest_pixel_does(offsets, want):
    pixels = window(offsets)
    np.testing.assert_array_equal(_plain_weights(pixels, pixels.usable), [want])
    assert not _plain_weights(pixels, ~pixels.usable).any()


def test_a_correction_is_the_least_squares_of_the_place_missed_and_of_its_own_size():
    """No other change of sum 0 of the pixels within 2.5 lowers |Σ weight · position|² + |change|²."""
    generator = np.random.default_rng(0)
    offset = generator.uniform(-2, 2, (12, 2))
    position = np.column_stack([offset[:, 0] + 0.4, offset[:, 1] + 0.1, 0.3 * offset[:, 0]])
    pixels = window(offset, position)
    weights = _plain_weights(pixels, pixels.usable)[0]
    change = _affine_correction(pixels, pixels.usable, weights[None])[0]
    near = np.linalg.norm(offset, axis=1) <= 2.5
    assert 0 < near.sum() < 12
    assert not change[~near].any()
    assert change.sum() == pytest.approx(0, abs=1e-12)

    def cost(change):
        return np.square((weights + change) @ position).sum() + np.square(change).sum()

    assert cost(change) < 0.5 * cost(0 * change)
    for _ in range(20):
        other = generator.normal(0, 1e-3, 12) * near
        other[near] -= other[near].mean()
        assert cost(change + other) > cost(change)


def test_a_reading_that_is_right_is_left_as_it_is():
    pixels = window(FOUR, np.column_stack([FOUR, np.zeros(4)]))
    weights = _plain_weights(pixels, pixels.usable)
    np.testing.assert_allclose(_affine_correction(pixels, pixels.usable, weights), 0, atol=1e-15)
    np.testing.assert_allclose(weights[0] @ np.array(FOUR), 0, atol=1e-15)


def test_one_pixel_alone_cannot_be_corrected():
    pixels = window([[1.0, 0.0]], [[0.7, 0, 0]])
    weights = _plain_weights(pixels, pixels.usable)
    assert not _affine_correction(pixels, pixels.usable, weights).any()


def test_slopes_of_a_tilted_face_by_hand():
    """From 2 m to 4 m over 5 pixels upwards 1 / z falls by 0.05 a pixel: at 2 m z rises by 2² · 0.05 = 0.2 m."""
    camera = Camera("front", np.eye(4), perspective(np.array([1.5, 1.0]), near=0.1, far=100.0), (20, 30))
    vertices = np.array([[0.0, 0, -2], [1, 0, -2], [0, 2, -4], [0, 0, -3], [0, 0, -5]])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 3, 4]]))  # the second one edge-on
    of_face, of_vertex = _slopes(mesh, camera)
    np.testing.assert_allclose(of_face, [0.2, 0])
    np.testing.assert_allclose(of_vertex, [0.2, 0.2, 0.2, 0, 0])


@pytest.mark.parametrize("mesh", [two_quads(), sphere(around=12, along=9)], ids=["quads", "sphere"])
def test_what_is_visible_is_read_with_sum_one_from_pixels_of_its_own_view(mesh):
    imager = TemplateImager.build(mesh, views=("front", "45/20"), size=(24, 20), backend="numpy")
    product, visible = sampling(mesh, imager.cameras, imager.raster)
    pixels = torch.eye(imager.mask.numel(), dtype=torch.float64)
    matrix = product(pixels).numpy().reshape(2, len(mesh.vertices), 2, -1)
    np.testing.assert_allclose(matrix.sum((2, 3))[visible], 1)
    assert not matrix[0, :, 1].any()
    assert not matrix[1, :, 0].any()
    covered = (imager.raster.face_id >= 0).reshape(2, -1)
    for view in range(2):
        assert not matrix[view, :, view][:, ~covered[view]].any()  # never the background
    np.testing.assert_array_equal(visible, imager.visible)


def test_a_vertex_behind_the_camera_is_read_from_nothing():
    camera = Camera("front", np.eye(4), perspective(np.array([1.0, 1.0]), near=0.1, far=100.0), (16, 16))
    mesh = Mesh(
        np.array([[-1.0, -1, -2], [1, -1, -2], [0, 1, -2], [0, 0, 2]]), np.array([[0, 1, 2], [0, 1, 3]])
    )
    imager = TemplateImager.build(mesh, cameras=(camera,), backend="numpy")
    assert imager.visible[0, 2]
    assert not imager.visible[0, 3]
    assert not imager.sample(imager.operator(torch.ones(4, 3)))[0, 3].any()
