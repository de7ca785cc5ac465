"""The losses of motion guided garments by hand values."""

import numpy as np
import torch

from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.motion_guided import losses

TRIANGLE = torch.tensor([[[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]])
EDGES = torch.tensor([[0, 1], [0, 2], [1, 2]])


def test_l1_norms_are_sums_over_axes_and_means_over_vertices():
    moved = TRIANGLE + torch.tensor([[1.0, -2, 0], [0, 0, 0], [0, 0, 3]])
    np.testing.assert_allclose(losses.geometry_loss(moved, TRIANGLE), (3 + 3) / 3)


def test_reconstruction_adds_the_laplacian():
    laplacian = graph_laplacian(np.array([[0, 1, 2]]), 3)
    raised = TRIANGLE + torch.tensor([[0, 0, 2.0], [0, 0, 0], [0, 0, 0]])  # 2, and -1 at both neighbours
    np.testing.assert_allclose(losses.reconstruction_loss(raised, TRIANGLE, laplacian), 2 / 3 + 4 / 3)


def test_codes_of_unit_variance_cost_nothing():
    code = torch.tensor([[1.0, -1, 1, -1], [2, 0, 0, 0], [0, 0, 0, 0]])
    np.testing.assert_allclose(losses.code_regularisation(code), (0 + 0 + 1) / 3)
    np.testing.assert_allclose(losses.code_loss(code[:1], code[1:2]), (1 + 1 + 1 + 1) / 4)


def test_edges_keep_their_lengths():
    np.testing.assert_allclose(losses.edge_lengths(TRIANGLE, EDGES), [[3, 4, 5]], rtol=1e-6)
    stretched = torch.stack([TRIANGLE[0], 2 * TRIANGLE[0]])
    np.testing.assert_allclose(losses.edge_loss(stretched, TRIANGLE[0], EDGES), (3 + 4 + 5) / 6, rtol=1e-6)


def test_clearance_ends_at_the_margin():
    np.testing.assert_allclose(
        losses.clearance_loss(torch.tensor([[-0.01, 0.001, 0.5, 0.002]]), 0.002),
        (0.012 + 0.001) / 4,
        rtol=1e-5,
    )
