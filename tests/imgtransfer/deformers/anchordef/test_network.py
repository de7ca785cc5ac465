"""Anchors' transformations and what they do to vertices, by hand values."""

import math

import numpy as np
import torch

from imgtransfer.deformers.anchordef.config import AnchorDefConfig
from imgtransfer.deformers.anchordef.network import (
    AnchorNetwork,
    Outputs,
    Sizes,
    anchor_transformations,
    deformed,
    euler_rotation,
)

SIZES = Sizes(vertices=4, faces=2, anchors=3, anchors_of_vertex=2, vertices_of_anchor=2)
CONFIG = AnchorDefConfig(width=8, anchors=3)


def _network() -> AnchorNetwork:
    torch.manual_seed(0)
    network = AnchorNetwork(CONFIG, SIZES, torch.randn(20, 5))
    network.neighbours.copy_(torch.tensor([[0, 1], [2, 3], [1, 3]]))
    network.anchors_near.copy_(torch.tensor([[0, 1], [0, 2], [1, 2], [2, 1]]))
    return network.eval()


def test_euler_angles_turn_about_x_then_y_then_z():
    quarter = math.pi / 2
    point = torch.tensor([1.0, 2.0, 3.0])
    for angles, want in (
        ([quarter, 0, 0], [1, -3, 2]),
        ([0, quarter, 0], [3, 2, -1]),
        ([0, 0, quarter], [-2, 1, 3]),
        ([quarter, quarter, 0], [2, -3, -1]),
        ([quarter, 0, quarter], [3, 1, 2]),
    ):
        turned = euler_rotation(torch.tensor(angles)) @ point
        np.testing.assert_allclose(turned, want, atol=1e-6)


def test_attention_and_blend_weights_are_sparse_and_sum_to_1():
    network = _network()
    with torch.no_grad():
        network.alpha[0] = torch.tensor([math.log(3.0), 0.0])
        network.logits[1] = torch.tensor([math.log(4.0), 7.0, 0.0])
        attention, weights = network.attention(), network.blend_weights()
    np.testing.assert_allclose(attention, [[0.75, 0.25, 0, 0], [0, 0, 0.5, 0.5], [0, 0.5, 0, 0.5]], atol=1e-7)
    np.testing.assert_allclose(
        weights, [[0.5, 0.5, 0], [0.8, 0, 0.2], [0, 0.5, 0.5], [0, 0.5, 0.5]], atol=1e-7
    )


def test_loose_and_tight_anchors_move_by_hand_values():
    anchors = torch.tensor([[1.0, 0, 0], [1.0, 0, 0]])
    angles = torch.tensor([[[0, 0, math.pi / 2]] * 2])
    outputs = Outputs(angles, torch.tensor([[[0, 0, 0.5]] * 2]), torch.zeros(1, 1, 3))
    half_turn = torch.diag(torch.tensor([-1.0, 1.0, -1.0])).expand(1, 2, 3, 3)  # about y
    lifted = torch.tensor([0.0, 10.0, 0.0]).expand(1, 2, 3)
    rotation, translation = anchor_transformations(
        outputs, anchors, torch.tensor([False, True]), half_turn, lifted
    )
    point = torch.tensor([2.0, 0, 0])  # 1 from the anchor along x: turned along y, and moved by 0.5 along z
    moved = rotation[0] @ point + translation[0]
    np.testing.assert_allclose(moved, [[1, 1, 0.5], [-1, 11, -0.5]], atol=1e-6)


def test_loose_transformations_are_equation_3_in_the_world():
    generator = torch.Generator().manual_seed(0)
    angles, shifts = torch.randn(2, 1, 1, 3, generator=generator).double()
    anchor, root_rest, root_posed, point = torch.randn(4, 3, generator=generator).double()
    outputs = Outputs(angles, shifts, torch.zeros(1, 1, 3))
    nothing = torch.eye(3).double().expand(1, 1, 3, 3), torch.zeros(1, 1, 3).double()
    rotation, translation = anchor_transformations(outputs, anchor[None], torch.tensor([False]), *nothing)
    r_global = euler_rotation(torch.tensor([0.3, -1.1, 2.0]).double())
    canonical = rotation[0, 0] @ point + translation[0, 0]
    world = r_global @ canonical + root_posed - r_global @ root_rest  # `RootFrames.to_world`
    r_n = rotation[0, 0]
    t_n = translation[0, 0] - root_rest + r_n @ root_rest  # x - J_root becomes R_n (x - J_root) + T_n
    r_loose = r_global @ r_n
    t_loose = r_global @ (t_n - r_n @ root_rest) + root_posed
    np.testing.assert_allclose(r_loose @ point + t_loose, world, atol=1e-12)


def test_vertices_are_blended_as_a_loop_would():
    generator = torch.Generator().manual_seed(1)
    points, translation = torch.randn(2, 4, 3, generator=generator), torch.randn(2, 3, 3, generator=generator)
    rotation = euler_rotation(torch.randn(2, 3, 3, generator=generator))
    weights = torch.rand(4, 3, generator=generator).softmax(1)
    want = torch.zeros(2, 4, 3)
    for frame in range(2):
        for vertex in range(4):
            for anchor in range(3):
                moved = rotation[frame, anchor] @ points[frame, vertex] + translation[frame, anchor]
                want[frame, vertex] += weights[vertex, anchor] * moved
    torch.testing.assert_close(deformed(points, weights, rotation, translation), want)


def test_a_batch_equals_its_singles():
    network = _network()
    torch.nn.init.normal_(network.displacements[2].weight)
    torch.nn.init.normal_(network.transformations[2].weight)
    features = torch.randn(3, 7, 5, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        whole = network(features)
        for clip in range(3):
            single = network(features[clip : clip + 1])
            for name in ("angles", "shifts", "displacements"):
                torch.testing.assert_close(getattr(single, name)[0], getattr(whole, name)[clip])


def test_the_first_state_is_random_in_training_only():
    network = _network()
    features = torch.zeros(1, 1, 5)
    torch.nn.init.normal_(network.transformations[2].weight)
    assert torch.equal(network(features).angles, network(features).angles)
    network.train()
    assert not torch.equal(network(features).angles, network(features).angles)
