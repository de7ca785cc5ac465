"""Vertices read from position maps."""

import numpy as np
import pytest
import torch

from fusion import initial_vertices
from fusion.initialise import InitialWeights
from render import InputError, Mesh, TemplateImager
from tests.helpers.fusion_examples import AROUND, imager_of, true_maps, tube, wrinkled


def test_seen_vertices_are_read_within_a_pixel_and_unseen_lie_between():
    mesh = tube()
    imager = imager_of(mesh, (128, 128))
    truth = wrinkled(mesh, 3)
    found = initial_vertices(imager, true_maps(imager, truth)[0])
    seen = imager.visible.any(0)
    assert 0 < (~seen).sum() < 0.2 * len(seen)
    error = (found - truth).norm(dim=-1)
    assert error[:, seen].mean() < 0.001  # a pixel is 3.5 mm, the folds 3 mm high
    assert error[:, ~seen].max() < 0.06  # the chord over the unseen strip of the tube, and leaning


def test_a_plane_that_moves_affinely_is_read_exactly_inside_and_within_a_pixel_at_its_rim():
    """An affine map of a flat template is linear in the surface, so its interpolation leaves no error. Outside
    the rim there is nothing to interpolate with."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.2, 0.2, 9)))
    row, column = (part.ravel() for part in np.mgrid[:8, :8])
    corner = row * 9 + column
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 10], 1), np.stack([corner, corner + 10, corner + 9], 1)]
    )
    mesh = Mesh(np.stack([x, y, 0 * x], 1), faces)
    imager = imager_of(mesh)
    affine = torch.tensor([[0.9, 0.1, 0.3], [-0.2, 1.1, 0.0], [0.4, 0.0, 1.0]])
    truth = torch.from_numpy(mesh.vertices).float() @ affine.T + torch.tensor([0.1, 0.0, -0.2])
    error = (initial_vertices(imager, imager.operator(truth)) - truth).norm(dim=-1)
    rim = torch.from_numpy(np.abs(mesh.vertices[:, :2]).max(1) > 0.19)
    assert error[~rim].max() < 2e-5  # float32
    assert error[rim].max() < 0.011  # a pixel: 0.4 m on 36 of them


def test_weights_of_every_vertex_sum_to_one():
    imager = imager_of(tube())
    constant = imager.operator(torch.full((AROUND * 17, 3), 0.7))
    torch.testing.assert_close(initial_vertices(imager, constant), torch.full((AROUND * 17, 3), 0.7))


def test_frontal_views_count_more():
    """Front map 0, left map 1: what both see is nearer to 0 towards the front and to 1 towards the side."""
    mesh = tube()
    imager = TemplateImager.build(mesh, views=("front", "left"), size=(48, 48), backend="numpy")
    maps = torch.zeros(2, 48, 48, 3)
    maps[1] = 1.0
    found = initial_vertices(imager, maps * imager.mask[..., None])[:, 0]
    both = np.flatnonzero(imager.visible.all(0))
    angle = np.rad2deg(np.arctan2(mesh.vertices[both, 0], mesh.vertices[both, 2]))
    assert len(both) > 20
    order = np.argsort(angle)
    assert (found[both].numpy()[order[angle[order] < 30]] < 0.5).all()
    assert (found[both].numpy()[order[angle[order] > 60]] > 0.5).all()


def test_an_unseen_vertex_is_interpolated_linearly_by_distance_along_edges():
    """A strip of four vertices along x seen at both ends only: thirds of the way."""
    imager = imager_of(tube())
    strip = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0], [3, 1, 0]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 5]])
    imager.mesh = Mesh(strip, faces)
    imager.visible = np.array(
        [[True, False, False, False, True, False], [False, False, False, True, False, True]]
    )
    readings = torch.zeros(2, 6, 1)
    readings[0, 0], readings[0, 4], readings[1, 3], readings[1, 5] = 0.0, 0.0, 3.0, 3.0
    found = InitialWeights(imager)(readings)[:, 0]
    # Vertex 1 has edges of length 1 to vertices 0 and 2, vertex 2 one of length 1 to vertex 3.
    torch.testing.assert_close(found, torch.tensor([0.0, 1.0, 2.0, 3.0, 0.0, 3.0]))


def test_a_piece_that_no_view_sees_takes_the_closest_seen_vertex():
    mesh = tube()
    n = len(mesh.vertices)
    inner = np.array([[0.0, 0, 0], [0.001, 0, 0], [0, 0.001, 0]])  # hidden inside the tube
    mesh = Mesh(np.concatenate([mesh.vertices, inner]), np.concatenate([mesh.faces, [[n, n + 1, n + 2]]]))
    imager = imager_of(mesh)
    assert not imager.visible[:, n:].any()
    found = initial_vertices(imager, imager.operator(torch.from_numpy(mesh.vertices).float()))
    assert torch.isfinite(found).all()
    assert (found[n:].norm(dim=-1) - 0.15).abs().max() < 0.01


def test_a_template_of_which_no_vertex_is_visible_says_so():
    imager = imager_of(tube())
    imager.visible = np.zeros_like(imager.visible)
    with pytest.raises(InputError, match="no view sees any of its 544 vertices"):
        initial_vertices(imager, torch.zeros(2, 48, 40, 3))


def test_batch_axes():
    imager = imager_of(tube())
    maps = true_maps(imager, wrinkled(tube(), 2))[0]
    found = initial_vertices(imager, maps)
    assert found.shape == (2, AROUND * 17, 3)
    torch.testing.assert_close(found[1], initial_vertices(imager, maps[1]))
