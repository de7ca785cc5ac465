"""Vertices read from position maps."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

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
    assert error[:, ~seen].mean() < 0.003  # a fold in the unseen strip is known by its ends only
    assert error[:, ~seen].max() < 0.010


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


def test_weights_of_every_seen_vertex_sum_to_one():
    """Maps that put all at one point say nothing of rotations: the rest keeps its offsets, near that point."""
    imager = imager_of(tube())
    found = initial_vertices(imager, imager.operator(torch.full((AROUND * 17, 3), 0.7)))
    seen = torch.from_numpy(imager.visible.any(0))
    torch.testing.assert_close(found[seen], torch.full((int(seen.sum()), 3), 0.7))
    assert (found - 0.7).abs().max() < 0.05


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


@pytest.mark.parametrize("size", [(48, 40), (128, 128)])
def test_the_template_itself_and_rigid_motions_of_its_maps_leave_no_error_where_no_view_sees(size):
    mesh = tube()
    imager = imager_of(mesh, size)
    rest = torch.from_numpy(mesh.vertices)
    unseen = torch.from_numpy(~imager.visible.any(0))
    turn = torch.from_numpy(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix())
    for truth in (rest, rest @ turn.T + torch.tensor([0.3, -1.0, 2.0])):
        error = (initial_vertices(imager, imager.operator(truth)) - truth).norm(dim=-1)
        assert error[unseen].max() < 1e-7


def test_maps_of_another_shape_of_the_garment_are_filled_by_that_shape():
    """Half as wide again as the template: its maps give it exactly once the shape is known."""
    mesh = tube()
    imager = imager_of(mesh, (64, 64))
    shape = Mesh(mesh.vertices * [1.5, 1, 1], mesh.faces)
    truth = torch.from_numpy(shape.vertices)
    unseen = torch.from_numpy(~imager.visible.any(0))
    readings = imager.sample(imager.operator(truth))
    for weights, wrong in ((InitialWeights(imager, shape), False), (InitialWeights(imager), True)):
        error = (weights(readings) - truth).norm(dim=-1)[unseen].max()
        assert (error > 1e-3) == wrong
        assert wrong or error < 1e-7


def test_a_piece_that_no_view_sees_goes_with_the_cloth_nearest_to_it():
    mesh = tube()
    n = len(mesh.vertices)
    inner = np.array([[0.0, 0, 0], [0.001, 0, 0], [0, 0.001, 0]])  # hidden inside the tube
    mesh = Mesh(np.concatenate([mesh.vertices, inner]), np.concatenate([mesh.faces, [[n, n + 1, n + 2]]]))
    imager = imager_of(mesh)
    assert not imager.visible[:, n:].any()
    moved = torch.from_numpy(mesh.vertices) + 0.25
    found = initial_vertices(imager, imager.operator(moved))
    torch.testing.assert_close(found[n:], moved[n:], rtol=0, atol=1e-7)


def test_vertices_whose_readings_a_frame_leaves_out_are_filled_from_the_others():
    """One pixel in five has no confidence, and holds what no garment could."""
    imager = imager_of(tube(), (96, 96))
    truth = wrinkled(tube(), 3)
    maps = true_maps(imager, truth)[0]
    out = torch.rand(maps.shape[:-1], generator=torch.Generator().manual_seed(0)) < 0.2
    confidence = (~out).float()
    maps[out] = 7.0
    weights = InitialWeights(imager)
    found = weights.read(maps, confidence)
    lost = ~found.seen & torch.from_numpy(weights.seen)
    assert (lost.sum(1) > 10).all()
    error = (found.vertices - truth).norm(dim=-1)
    assert error[lost].mean() < 0.003  # the folds are 5 mm high
    for frame in range(3):
        alone = weights.read(maps[[frame]], confidence[[frame]]).vertices
        torch.testing.assert_close(alone[0], found.vertices[frame], rtol=0, atol=1e-6)


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
