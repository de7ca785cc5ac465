"""The garment's texture space."""

import numpy as np
import pytest

from imgtransfer.data.clip_parts import Template
from imgtransfer.deformers.motion_guided.texture_space import covered, texture_space
from render.mesh.surface import Surface
from tests.helpers.synthetic import tube

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_pixels_of_a_triangle_by_hand():
    pixels, triangle, weights = covered(np.array([[[0, 0], [4, 0], [0, 2.0]]]), 4)
    # Centres (0.5, 0.5), (1.5, 0.5), (2.5, 0.5) and (0.5, 1.5) lie in it.
    np.testing.assert_array_equal(pixels, [0, 1, 2, 4])
    np.testing.assert_array_equal(triangle, 0)
    np.testing.assert_allclose(weights[0], [1 - 0.125 - 0.25, 0.125, 0.25])
    np.testing.assert_allclose(weights[3], [1 - 0.125 - 0.75, 0.125, 0.75])


@pytest.mark.parametrize(
    "triangle", [[[0, 0], [4, 0], [2, 0]], [[9, 9], [12, 9], [9, 12]]], ids=["flat", "outside"]
)
def test_triangles_that_cover_nothing(triangle):
    pixels, _, weights = covered(np.array([triangle], float), 4)
    assert pixels.shape == (0,)
    assert weights.shape == (0, 3)


def test_coordinates_of_the_template_are_stretched_to_the_square():
    uvs = np.array([[2, 5], [4, 5], [4, 6], [2, 6]], np.float32)
    template = Template(SQUARE, FACES, Surface(FACES, np.arange(4), uvs, FACES))
    space = texture_space(template, 8)
    np.testing.assert_allclose(space.uvs, SQUARE[:, :2])
    np.testing.assert_array_equal(space.pixels, np.arange(64))
    shown = (SQUARE[space.corners] * space.weights[..., None]).sum(1)
    rows, columns = np.divmod(np.arange(64), 8)
    np.testing.assert_allclose(shown[:, :2], (np.stack([columns, rows], -1) + 0.5) / 8, atol=1e-6)


def test_coordinates_go_by_the_vertices_in_use():
    # The file has the vertices the other way round.
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    surface = Surface(3 - FACES, np.array([3, 2, 1, 0]), uvs, FACES)
    np.testing.assert_allclose(texture_space(Template(SQUARE, FACES, surface), 4).uvs, uvs)


@pytest.mark.parametrize("faces_without", [False, True], ids=["no texture", "faces without coordinates"])
def test_a_template_without_coordinates_gets_charts(faces_without):
    vertices, faces = tube(0.2, 1.0, 6, 12, closed=False)
    surface = Surface(faces, np.arange(len(vertices)), np.zeros((1, 2), np.float32), np.full_like(faces, -1))
    space = texture_space(Template(vertices, faces, surface if faces_without else None), 32)
    assert len(space.pixels) > 0.3 * 32**2
    assert 0 <= space.uvs.min() <= space.uvs.max() <= 1
    assert len(np.unique(space.corners)) > 0.9 * len(vertices)
    # A chart keeps neighbours together: each pixel shows a place near the vertex that is read nearest to it.
    shown = (vertices[space.corners] * space.weights[..., None]).sum(1)
    rows, columns = np.divmod(space.pixels, 32)
    centres = (np.stack([columns, rows], -1) + 0.5) / 32
    nearest = np.linalg.norm(centres[:, None] - space.uvs, axis=-1).argmin(1)
    assert np.median(np.linalg.norm(shown - vertices[nearest], axis=1)) < 0.15
