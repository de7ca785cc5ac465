"""Pixels put in the order of their faces, and slopes of linear functions, against loops."""

import numpy as np
import pytest
import torch

from fusion import Topology
from fusion.solvers.pixel_faces import PixelFaces, gradient_laplacian
from render import TemplateImager
from tests.helpers.example_meshes import random_soup, two_quads

QUADS = two_quads()


@pytest.fixture(scope="module")
def drawn():
    """The quads from three sides in images that are not square, and their pixels."""
    imager = TemplateImager.build(QUADS, views=("front", "back", "45/20"), size=(12, 17), backend="numpy")
    return imager, PixelFaces.of(imager.raster, Topology(QUADS))


def test_every_covered_pixel_stands_once_with_the_face_that_it_shows(drawn):
    imager, pixels = drawn
    face, barycentric = imager.raster.face_id.ravel(), imager.raster.barycentric.reshape(-1, 3)
    assert sorted(pixels.places.tolist()) == np.flatnonzero(face >= 0).tolist()
    last = -1
    for k, (first, end) in enumerate(zip(pixels.pixel_start[:-1], pixels.pixel_start[1:], strict=True)):
        places = pixels.places[first:end].numpy()
        (number,) = set(face[places])  # all of one face
        assert number > last  # faces in their order
        assert pixels.faces[k].tolist() == QUADS.faces[number].tolist()
        assert (np.diff(places) > 0).all()  # and pixels, within each
        np.testing.assert_array_equal(pixels.weights[first:end], barycentric[places])
        last = number


def test_counts_by_face_are_those_of_the_raster(drawn):
    imager, pixels = drawn
    counts = np.bincount(imager.raster.face_id[imager.raster.face_id >= 0], minlength=len(QUADS.faces))
    assert pixels.pixels_per_face().tolist() == counts[counts > 0].tolist()
    assert pixels.pixel_start[-1] == len(pixels.places) == len(pixels.weights)


def test_faces_that_nothing_shows_are_left_out():
    """From the front the small square stands behind the large one."""
    imager = TemplateImager.build(QUADS, views=("front",), size=(16, 16), backend="numpy")
    pixels = PixelFaces.of(imager.raster, Topology(QUADS))
    assert pixels.faces.tolist() == QUADS.faces[:2].tolist()


def test_interpolation_is_a_weighted_sum_over_each_pixel_s_corners(drawn):
    imager, pixels = drawn
    values = torch.from_numpy(np.random.default_rng(0).normal(size=(2, len(QUADS.vertices), 3)))
    found = pixels.product(len(QUADS.vertices))(values).numpy()
    face, barycentric = imager.raster.face_id.ravel(), imager.raster.barycentric.reshape(-1, 3)
    for row, place in enumerate(pixels.places.tolist()):
        corners = values[:, QUADS.faces[face[place]]].numpy()  # (2, 3 corners, 3)
        np.testing.assert_allclose(found[:, row], (corners * barycentric[place][:, None]).sum(1), atol=1e-12)


def test_slopes_of_a_linear_function_on_random_triangles():
    """w = g · x has on each face the part of g along it: |g|² - (g · n)²."""
    mesh = random_soup(3, n_vertices=12, n_faces=8)
    weights = np.random.default_rng(1).random(8)
    slope = np.array([0.3, -2.0, 0.7])
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    want = (weights * (slope @ slope - (normals @ slope) ** 2)).sum()
    matrix, values = gradient_laplacian(mesh.vertices, mesh.faces, weights), mesh.vertices @ slope
    assert values @ matrix @ values == pytest.approx(want)


def test_it_is_symmetric_positive_and_blind_to_constants():
    mesh = random_soup(4, n_vertices=10, n_faces=9)
    matrix = gradient_laplacian(mesh.vertices, mesh.faces, np.ones(9)).toarray()
    np.testing.assert_allclose(matrix, matrix.T)
    np.testing.assert_allclose(matrix @ np.ones(10), 0, atol=1e-9 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()


@pytest.mark.parametrize("scale", [0.01, 1000.0])
def test_it_is_per_square_metre_whatever_the_place(scale):
    mesh = random_soup(5, n_vertices=6, n_faces=4)
    matrices = [
        gradient_laplacian(vertices, mesh.faces, np.ones(4)).toarray()
        for vertices in (mesh.vertices, scale * (mesh.vertices[:, [2, 0, 1]] + 0.25))
    ]
    np.testing.assert_allclose(matrices[1] * scale**2, matrices[0], rtol=1e-6)


def test_faces_without_area_or_pixels_add_nothing():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0.5, 1e-4, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 1, 1]])  # one whole, three without or nearly so
    found = gradient_laplacian(vertices, faces, np.ones(4)).toarray()
    alone = gradient_laplacian(vertices, faces[:1], np.ones(1)).toarray()
    np.testing.assert_array_equal(found, alone)
    assert gradient_laplacian(vertices, faces[:0], np.ones(0)).nnz == 0
