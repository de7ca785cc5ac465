"""The kernels' objective and gradient against the losses and automatic differentiation."""

import numpy as np
import pytest
import torch

from fusion import Topology
from fusion.losses import (
    displacement_loss,
    edge_length_loss,
    normal_consistency_loss,
    normal_rendering_loss,
)
from fusion.solvers.energy import TERMS, Energy
from fusion.solvers.pixel_faces import PixelFaces, gradient_laplacian
from fusion.solvers.recorder import lanes_on
from render import Mesh
from render.mesh.normals import safe_normalize
from tests.helpers.fusion_examples import imager_of, tube, wrinkled

WEIGHTS = {
    "edge_length_m2": 3.0,
    "displacement_m2": 5.0,
    "normal_consistency": 0.7,
    "normal_rendering": 1.3,
}
FRAMES = 4


@pytest.fixture(scope="module")
def parts():
    imager = imager_of(tube())
    topology = Topology(imager.mesh)
    return topology, PixelFaces.of(imager.raster, topology)


def problem(parts, dtype=torch.float64):
    topology, pixel_faces = parts
    generator = torch.Generator().manual_seed(0)

    def noise(*shape):
        return torch.randn(*shape, generator=generator, dtype=torch.float64).to(dtype)

    vertices = wrinkled(tube(), FRAMES).to(dtype) + 0.002 * noise(FRAMES, topology.n_vertices, 3)
    anchor = vertices + 0.003 * noise(*vertices.shape)
    vertex_weights = noise(FRAMES, topology.n_vertices).abs()
    target = safe_normalize(noise(FRAMES, len(pixel_faces.places), 3))
    confidence = noise(FRAMES, len(pixel_faces.places)).abs()
    return vertices, anchor, vertex_weights, target, confidence


def expected(parts, vertices, *rest):
    anchor, vertex_weights, target, confidence = rest
    topology, pixel_faces = parts
    normals = topology.normals(vertices)
    rendered = pixel_faces.product(topology.n_vertices)(normals)
    return {
        "edge_length_m2": edge_length_loss(vertices, topology),
        "displacement_m2": displacement_loss(vertices, anchor, vertex_weights),
        "normal_consistency": normal_consistency_loss(normals, topology),
        "normal_rendering": normal_rendering_loss(rendered, target, confidence),
    }


@pytest.mark.parametrize("left_out", [None, *WEIGHTS])
def test_terms_and_gradient_equal_the_losses_in_float64(parts, left_out):
    vertices, *rest = problem(parts)
    anchor, vertex_weights, target, confidence = rest
    weights = {name: weight for name, weight in WEIGHTS.items() if name != left_out}
    energy = Energy(
        parts[0], weights, anchor, vertex_weights, pixel_faces=parts[1], target=target, confidence=confidence
    )
    energy.vertices.copy_(vertices)
    found = dict(zip(TERMS, energy.evaluate().T, strict=True))
    vertices.requires_grad_()
    want = expected(parts, vertices, *rest)
    total = sum(weight * want[name].sum() for name, weight in weights.items())
    (gradient,) = torch.autograd.grad(total, vertices)
    for name in weights:
        torch.testing.assert_close(found[name], want[name].detach(), rtol=1e-10, atol=1e-14)
    torch.testing.assert_close(energy.gradient, gradient, rtol=1e-9, atol=1e-12)


def test_float32_is_float64_within_rounding(parts):
    energies = []
    for dtype in (torch.float32, torch.float64):
        vertices, anchor, vertex_weights, target, _ = problem(parts, dtype)
        energies.append(
            Energy(parts[0], WEIGHTS, anchor, vertex_weights, pixel_faces=parts[1], target=target)
        )
        energies[-1].vertices.copy_(vertices)
    terms = [energy.evaluate() for energy in energies]
    torch.testing.assert_close(*terms, rtol=2e-4, atol=1e-9)
    single, double = (energy.gradient.double() for energy in energies)
    assert (single - double).norm() < 1e-4 * double.norm()


def test_frames_do_not_touch_each_other(parts):
    vertices, anchor, vertex_weights, target, confidence = problem(parts, torch.float32)

    def evaluated(frames):
        energy = Energy(
            parts[0],
            WEIGHTS,
            anchor[frames],
            vertex_weights[frames],
            pixel_faces=parts[1],
            target=target[frames],
            confidence=confidence[frames],
        )
        energy.vertices.copy_(vertices[frames])
        return energy.evaluate(), energy.gradient

    terms, gradient = evaluated(slice(None))
    for frame in range(FRAMES):
        alone = evaluated(slice(frame, frame + 1))
        assert torch.equal(alone[1][0], gradient[frame])
        torch.testing.assert_close(alone[0][0], terms[frame], rtol=1e-12, atol=0)


def test_groups_without_active_frames_keep_their_last_values(parts):
    """Two groups and a bit: the first rests, the others go on, whole."""
    lanes = lanes_on(torch.device("cpu"))
    frames = 2 * lanes + 3
    vertices, anchor, vertex_weights, *_ = (torch.cat([tensor] * 5)[:frames] for tensor in problem(parts))
    energy = Energy(parts[0], {"edge_length_m2": 1.0}, anchor, vertex_weights)
    before, gradient = energy.evaluate(), energy.gradient.clone()
    energy.vertices.copy_(vertices)
    energy.activate(torch.arange(frames) >= frames - 4)  # the last of the second group, and the third
    after = energy.evaluate()
    assert torch.equal(after[:lanes], before[:lanes])
    assert torch.equal(energy.gradient[:lanes], gradient[:lanes])
    assert (after[lanes:, 0] != before[lanes:, 0]).all()


def test_a_face_without_area_and_a_vertex_without_face_have_finite_gradients():
    mesh = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [5, 5, 5]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 3, 3]]),
    )
    topology = Topology(mesh)
    anchor = torch.from_numpy(mesh.vertices)[None].clone()
    energy = Energy(topology, WEIGHTS, anchor, torch.full((1, 5), 0.2))
    assert torch.isfinite(energy.evaluate()).all()
    assert torch.isfinite(energy.gradient).all()
    assert torch.equal(energy.gradient[0, 4], torch.zeros(3, dtype=torch.float64))


def test_gradient_laplacian_of_a_linear_function_is_its_slope_squared():
    """Two triangles of a square with sides of 2 m and w = 3 x: |∇w|² = 9 in both, with weights 0.25 and 0.5."""
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    faces, w = np.array([[0, 1, 2], [0, 2, 3]]), 3 * vertices[:, 0]
    matrix = gradient_laplacian(vertices, faces, np.array([0.25, 0.5]))
    assert w @ matrix @ w == pytest.approx(9 * 0.75)
    np.testing.assert_allclose(matrix @ np.ones(4), 0, atol=1e-12)


def test_pixels_in_the_order_of_their_faces_are_the_renderer_s(parts):
    imager = imager_of(tube())
    values = torch.from_numpy(tube().vertices)
    want = imager.operator(values).reshape(-1, 3)[parts[1].places]
    torch.testing.assert_close(parts[1].product(len(values))(values), want)
