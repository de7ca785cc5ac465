"""AnchorDEF's losses by hand values."""

import math

import numpy as np
import torch

from imgtransfer.deformers.anchordef import losses
from imgtransfer.deformers.common.laplacian import graph_laplacian


def test_squared_distance_sums_over_vertices_and_means_over_frames():
    predicted = torch.zeros(2, 2, 3)
    target = torch.tensor([[[3.0, 4, 0], [0, 0, 1]], [[0, 0, 0], [0, 0, 2]]])
    assert losses.squared_distance(predicted, target).item() == (25 + 1 + 4) / 2


def test_graph_laplacian_is_a_vertex_less_the_mean_of_its_neighbours():
    laplacian = graph_laplacian(np.array([[0, 1, 2], [0, 2, 3]]), 5)  # the fifth is in no face
    values = torch.tensor([[6.0], [0], [3], [9], [100]])
    np.testing.assert_allclose(laplacian(values)[:, 0], [6 - 4, 0 - 4.5, 3 - 5, 9 - 4.5, 0])


def test_laplacian_loss_does_not_see_a_translation():
    laplacian = graph_laplacian(np.array([[0, 1, 2]]), 3)
    target = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    assert losses.laplacian_loss(target + 5, target, laplacian).item() < 1e-9
    raised = target + torch.tensor([[0, 0, 0], [0, 0, 0], [0, 0, 2.0]])  # 2, and -1 at both neighbours
    np.testing.assert_allclose(losses.laplacian_loss(raised, target, laplacian), 4 + 1 + 1)


def test_collision_ends_at_the_margin():
    vertices = torch.tensor([[[0, 0, -0.1], [0, 0, 0.05], [0, 0, 0.3]]])
    points, normals = torch.zeros(1, 3, 3), torch.tensor([0, 0, 1.0]).expand(1, 3, 3)
    np.testing.assert_allclose(
        losses.collision_loss(vertices, points, normals, 0.1), 0.2**2 + 0.05**2, rtol=1e-5
    )


def test_consistency_of_places_and_normals():
    at, up, side = torch.zeros(1, 1, 3), torch.tensor([[[0, 0, 1.0]]]), torch.tensor([[[1.0, 0, 0]]])
    np.testing.assert_allclose(losses.consistency_loss(at + 1, up, at, side, 0.1), 3 + 0.1 * 2, rtol=1e-6)
    assert losses.consistency_loss(at, up, at, up, 0.1).item() == 0


def test_direction_is_one_minus_the_cosine_and_has_a_gradient_on_the_target():
    normal = torch.tensor([[[0, 0, 1.0]] * 4])
    moved = torch.tensor([[[0, 0, 2.0], [0, 0, -2.0], [1.0, 0, 1.0], [0, 0, 0]]], requires_grad=True)
    loss = losses.direction_loss(moved, torch.zeros(1, 4, 3), normal)
    np.testing.assert_allclose(loss.item(), (0 + 2 + 1 - math.sqrt(0.5) + 1) / 4, rtol=1e-6)
    loss.backward()
    assert moved.grad.isfinite().all()


def test_chamfer_sums_both_ways_and_leaves_padding_out():
    anchors = torch.tensor([[[0.0, 0, 0], [1, 0, 0]]])
    vertices = torch.tensor([[[0.0, 0, 1], [5, 0, 0], [0, 0, 0]]])
    valid = torch.tensor([[True, True, False]])
    # anchors to vertices: 1 and 2; vertices to anchors: 1 and 16
    assert losses.chamfer_loss(anchors, vertices, valid).item() == 1 + 2 + 1 + 16
