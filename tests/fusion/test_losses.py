"""Each term of equations 5 to 7: hand value, plain loop, gradient, laws."""

from functools import partial

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fusion import (
    Topology,
    collision_loss,
    displacement_loss,
    edge_length_loss,
    normal_consistency_loss,
    normal_rendering_loss,
)
from fusion.losses import anchor_weights
from render import Mesh, vertex_normals
from tests.helpers.fusion_examples import tube, wrinkled

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))


def moved_tube(
    dtype: torch.dtype = torch.float64, batch: tuple[int, ...] = (2,)
) -> tuple[Topology, torch.Tensor]:
    mesh = tube()
    noise = torch.randn(
        *batch, len(mesh.vertices), 3, generator=torch.Generator().manual_seed(0), dtype=dtype
    )
    return Topology(mesh), torch.from_numpy(mesh.vertices).to(dtype) + 0.005 * noise


def test_edge_length_of_a_scaled_triangle():
    doubled = 2 * torch.from_numpy(TRIANGLE.vertices)  # edges 3, 4, 5 grow by 3, 4, 5
    torch.testing.assert_close(edge_length_loss(doubled, Topology(TRIANGLE)).item(), (9 + 16 + 25) / 3)


def test_edge_length_against_a_loop():
    topology, vertices = moved_tube()
    rest = tube().vertices
    for frame, found in zip(vertices.numpy(), edge_length_loss(vertices, topology).tolist(), strict=True):
        squares = [
            (np.linalg.norm(frame[i] - frame[j]) - np.linalg.norm(rest[i] - rest[j])) ** 2
            for i, j in tube().edges
        ]
        assert found == pytest.approx(np.mean(squares), rel=1e-12)


def test_normal_rendering_by_hand():
    rendered = torch.tensor([[[0.0, 0, 1], [1, 0, 0]], [[0, 0, 1], [0, 0, 1]]])
    target = torch.tensor([[[0.0, 0, 1], [0, 1, 0]], [[0, 0, -1], [0, 0, -1]]])
    torch.testing.assert_close(normal_rendering_loss(rendered, target), torch.tensor([2**0.5 / 2, 2.0]))


@pytest.mark.parametrize(("degrees", "want"), [(0, 0.0), (60, 0.5), (90, 1.0), (180, 2.0)])
def test_normal_consistency_of_two_directions(degrees, want):
    """Vertices 1 and 2 share a direction, vertex 0 differs: two of the three edges count 1 - cos."""
    turn = np.deg2rad(degrees)
    normals = torch.tensor([[np.sin(turn), 0, np.cos(turn)], [0, 0, 1], [0, 0, 1]])
    assert normal_consistency_loss(normals, Topology(TRIANGLE)).item() == pytest.approx(
        want * 2 / 3, abs=1e-12
    )


def test_normal_consistency_against_a_loop():
    topology, vertices = moved_tube()
    normals = topology.normals(vertices)
    found = normal_consistency_loss(normals, topology)
    for frame, value in zip(normals.numpy(), found.tolist(), strict=True):
        assert value == pytest.approx(np.mean([1 - frame[i] @ frame[j] for i, j in tube().edges]), rel=1e-10)


def test_displacement_by_hand_with_and_without_weights():
    anchor = torch.zeros(3, 3)
    vertices = torch.tensor([[0.3, 0, 0.4], [0, 0, 0], [1.0, 0, 0]])
    assert displacement_loss(vertices, anchor).item() == pytest.approx(1.25 / 3)
    weights = anchor_weights(torch.tensor([True, True, False]))
    assert displacement_loss(vertices, anchor, weights).item() == pytest.approx(0.125)
    assert displacement_loss(vertices, anchor, torch.zeros(3)).item() == 0.0


def test_a_vertex_s_confidence_scales_its_own_displacement_only():
    seen, confidence = torch.tensor([True, True, False]), torch.tensor([[0.5, 1.0, 3.0], [1.0, 0.0, 1.0]])
    assert anchor_weights(seen, confidence).tolist() == [[0.25, 0.5, 0.0], [0.5, 0.0, 0.0]]
    assert anchor_weights(torch.zeros(3, dtype=torch.bool)).tolist() == [0.0, 0.0, 0.0]


def test_each_frame_s_vertices_are_weighed_by_how_many_it_sees():
    """They were divided by what all frames of the batch see: more frames at once held their vertices less."""
    seen = torch.tensor([[True, True, False, True], [False, True, False, False], [False] * 4])
    confidence = torch.tensor([[3.0, 6.0, 9.0, 1.5], [1.0, 0.5, 1.0, 1.0], [1.0] * 4])
    assert anchor_weights(seen, confidence).tolist() == [
        [1.0, 2.0, 0.0, 0.5],
        [0.0, 0.5, 0.0, 0.0],
        [0.0] * 4,
    ]
    torch.testing.assert_close(anchor_weights(seen)[0], torch.tensor([1 / 3, 1 / 3, 0, 1 / 3]))


def test_a_pixel_s_confidence_scales_its_own_distance_only():
    rendered = torch.tensor([[0.0, 0, 1], [0, 1, 0]])
    target = torch.tensor([[0.0, 0, -1], [0, 0, 1]])
    want = (0.25 * 2 + 2 * np.sqrt(2)) / 2
    found = normal_rendering_loss(rendered, target, torch.tensor([0.25, 2.0]))
    assert found.item() == pytest.approx(want)


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_lengths_in_another_unit_scale_squared_terms_twice_and_depths_once(scale):
    vertices = torch.randn(5, 3, 3, generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    scaled = Topology(Mesh(scale * TRIANGLE.vertices, TRIANGLE.faces))
    found, want = (displacement_loss(v, 0.5 * v.flip(0)) for v in (scale * vertices, vertices))
    torch.testing.assert_close(found, scale**2 * want)
    edges = scale**2 * edge_length_loss(vertices, Topology(TRIANGLE))
    torch.testing.assert_close(edge_length_loss(scale * vertices, scaled), edges)
    depth = collision_loss(vertices[..., 0], margin_m=0.3)
    torch.testing.assert_close(collision_loss(scale * vertices[..., 0], margin_m=0.3 * scale), scale * depth)


def test_collision_by_hand():
    distance = torch.tensor([[-0.002, 0.001, 0.05], [0.01, 0.01, 0.01]])
    torch.testing.assert_close(collision_loss(distance), torch.tensor([0.002 / 3, 0.0]))
    torch.testing.assert_close(collision_loss(distance, margin_m=0.004), torch.tensor([0.009 / 3, 0.0]))


def test_no_pixels_and_no_vertices_give_zero():
    assert normal_rendering_loss(torch.zeros(2, 0, 3), torch.zeros(2, 0, 3)).tolist() == [0.0, 0.0]
    assert collision_loss(torch.zeros(2, 0)).tolist() == [0.0, 0.0]


def test_gradients_at_exact_agreement_are_zero_not_nan():
    topology, normals = Topology(TRIANGLE), torch.tensor([[0.0, 0, 1]] * 3, requires_grad=True)
    vertices = torch.from_numpy(TRIANGLE.vertices).float().requires_grad_()
    total = normal_rendering_loss(normals, normals.detach()) + edge_length_loss(vertices, topology)
    total.backward()
    assert torch.equal(normals.grad, torch.zeros(3, 3))
    assert torch.equal(vertices.grad, torch.zeros(3, 3))


def test_an_edge_without_length_has_a_finite_gradient():
    vertices = torch.zeros(3, 3, requires_grad=True)
    edge_length_loss(vertices, Topology(TRIANGLE)).backward()
    assert torch.isfinite(vertices.grad).all()


@pytest.mark.parametrize("name", ["edge", "rendering", "consistency", "displacement", "collision"])
def test_gradcheck(name):
    generator = torch.Generator().manual_seed(1)
    topology = Topology(TRIANGLE)
    x = torch.randn(2, 3, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    other = torch.randn(2, 3, 3, generator=generator, dtype=torch.float64)
    function, argument = {
        "edge": (partial(edge_length_loss, topology=topology), x),
        "rendering": (partial(normal_rendering_loss, target=other), x),
        "consistency": (lambda v: normal_consistency_loss(topology.normals(v), topology), x),
        "displacement": (
            partial(displacement_loss, anchor=other, vertex_weights=torch.tensor([1.0, 0.5, 0.0]).double()),
            x,
        ),
        "collision": (
            partial(collision_loss, margin_m=0.004),
            torch.tensor(
                [[-3e-3, 1e-3, 9e-3]], dtype=torch.float64, requires_grad=True
            ),  # none near the kink
        ),
    }[name]
    assert torch.autograd.gradcheck(function, (argument,))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (1,), (2, 3)])
def test_rigid_motion_changes_neither_lengths_nor_consistency(batch, dtype):
    topology, vertices = moved_tube(dtype, batch)
    rotation = torch.from_numpy(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()).to(dtype)
    moved = vertices @ rotation.T + torch.tensor([0.1, 0.2, -0.3], dtype=dtype)
    tolerance = 1e-12 if dtype == torch.float64 else 1e-6
    for loss in (edge_length_loss, lambda v, t: normal_consistency_loss(t.normals(v), t)):
        found = loss(moved, topology)
        assert found.shape == batch
        assert found.dtype == dtype
        torch.testing.assert_close(found, loss(vertices, topology), rtol=0, atol=tolerance)


def test_the_template_itself_costs_nothing():
    topology = Topology(tube())
    assert edge_length_loss(torch.from_numpy(tube().vertices), topology).item() < 1e-30


def test_normals_equal_the_renderer_s():
    mesh = tube()
    vertices = wrinkled(mesh, 3)
    want = vertex_normals(vertices, torch.from_numpy(mesh.faces))
    torch.testing.assert_close(Topology(mesh).normals(vertices), want)


def test_batch_equals_singles():
    topology, vertices = moved_tube(batch=(3,))
    for loss in (edge_length_loss, lambda v, t: normal_consistency_loss(t.normals(v), t)):
        singles = torch.stack([loss(frame, topology) for frame in vertices])
        torch.testing.assert_close(loss(vertices, topology), singles, rtol=1e-12, atol=0)
