"""Kernel weights, skinning and local axes."""

import math

import numpy as np
import torch

from imgtransfer.data.clip_parts import Template
from imgtransfer.deformers.motion_guided.skinning import Rest, Seeds, kernel_weights, local_axes, posed
from tests.helpers.synthetic import tube


def test_kernel_weights_by_hand():
    points, seeds = torch.tensor([[[0.0, 0, 0]]]), torch.tensor([[1.0, 0, 0], [0, 2, 0]])
    weights = kernel_weights(points, seeds, torch.tensor([1.0, 2.0]))
    first, second = math.exp(-0.5), math.exp(-4 / 8)
    np.testing.assert_allclose(weights, [[[first / (first + second), second / (first + second)]]], atol=1e-6)


def test_a_garment_between_a_still_and_a_turned_seed_point():
    quarter = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotation = torch.stack([torch.eye(3), quarter])[None]
    translation = torch.tensor([[[0.0, 0, 0], [0, 0, 2]]])
    seeds = Seeds(torch.zeros(1, 2, 3), torch.zeros(1, 2, 3), rotation, translation)
    garment, turns = posed(torch.tensor([[[1.0, 0, 0]]]), torch.tensor([[[0.25, 0.75]]]), seeds)
    np.testing.assert_allclose(garment, [[[0.25, 0.75, 1.5]]])
    np.testing.assert_allclose(turns[0, 0], 0.25 * torch.eye(3) + 0.75 * quarter)


def test_displacements_are_along_the_local_axes():
    axes = torch.tensor([[[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]])
    rest = Rest(torch.tensor([[5.0, 5, 5]]), axes, torch.zeros(1, 3))
    np.testing.assert_allclose(rest.displaced(torch.tensor([[[1.0, 2, 3]]])), [[[5 + 3, 5 + 1, 5 + 2]]])


def test_local_axes_are_right_handed_with_the_normal_outwards():
    vertices, faces = tube(0.2, 1.0, 5, 12, closed=False)
    axes = local_axes(Template(vertices, faces))
    np.testing.assert_allclose(axes.swapaxes(1, 2) @ axes, np.tile(np.eye(3), (60, 1, 1)), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-5)
    outwards = vertices * [1, 0, 1] / 0.2
    assert ((axes[:, :, 2] * outwards).sum(1) > 0.99).all()


def test_vertices_without_a_normal_have_the_coordinate_axes():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [7, 7, 7]], np.float32)
    axes = local_axes(Template(vertices, np.array([[0, 1, 2]])))
    np.testing.assert_array_equal(axes[3], np.eye(3))
    np.testing.assert_allclose(axes[:3, :, 2], [[0, 0, 1]] * 3)
