import copy
import pickle

import numpy as np
import pytest
import torch

from render import InputError, MapOperator, Raster, frame_cameras, rasterize
from tests.helpers.example_meshes import random_soup, tube, two_triangles

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]


def make(mesh, size=(24, 32), views=("front", "back")):
    raster = rasterize(mesh, frame_cameras(mesh, views=views, size=size), backend="numpy")
    return raster, MapOperator(raster, mesh.faces, len(mesh.vertices))


def by_loop(raster, faces, attributes):
    """The definition: every covered pixel is the weighted sum of its face's three vertices."""
    images = np.zeros((*raster.face_id.shape, attributes.shape[-1]))
    for place in np.argwhere(raster.mask):
        s, i, j = place
        for corner in range(3):
            vertex = faces[raster.face_id[s, i, j], corner]
            images[s, i, j] += raster.barycentric[s, i, j, corner] * attributes[vertex]
    return images


def test_map_values_by_hand():
    # The square fills a 4 x 4 image: pixel centres lie at -0.375, -0.125, 0.125, 0.375 m. Positions are linear, so
    # the map of positions is the pixel centres themselves.
    mesh = two_triangles()
    cameras = frame_cameras(mesh, views=["front"], size=(4, 4), fov_degrees=90, margin=0)
    operator = MapOperator(rasterize(mesh, cameras), mesh.faces, 4)
    images = operator(torch.tensor(mesh.vertices))
    centres = torch.tensor([-0.375, -0.125, 0.125, 0.375], dtype=torch.float64)
    assert images.shape == (1, 4, 4, 3)
    torch.testing.assert_close(images[0, :, :, 0], centres.expand(4, 4), atol=1e-12, rtol=0)
    torch.testing.assert_close(images[0, :, :, 1], -centres[:, None].expand(4, 4), atol=1e-12, rtol=0)
    # A value of 1 at vertex 1 only (lower right): face 0 has it with weight x - y (0 on the diagonal, 1 at the corner).
    spike = operator(torch.tensor([[0.0], [1], [0], [0]], dtype=torch.float64))[0, :, :, 0]
    assert spike[3, 3].item() == pytest.approx(0.75)  # x = 0.375, y = -0.375
    assert spike[3, 2].item() == pytest.approx(0.5)
    assert spike[0, 0].item() == 0  # the other face


@pytest.mark.parametrize("mesh", [tube(12, 8), random_soup(3, 30, 20)], ids=["tube", "random"])
def test_equals_the_plain_loop(mesh):
    raster, operator = make(mesh)
    attributes = np.random.default_rng(0).normal(size=(len(mesh.vertices), 5))
    images = operator(torch.tensor(attributes))
    np.testing.assert_allclose(images.numpy(), by_loop(raster, mesh.faces, attributes), atol=1e-13)
    assert (images[~operator.mask] == 0).all()
    np.testing.assert_array_equal(operator.mask.numpy(), raster.mask)


def test_adjoint_identity():
    mesh = tube(20, 12)
    _, operator = make(mesh)
    torch.manual_seed(0)
    x = torch.randn(3, len(mesh.vertices), 4, dtype=torch.float64)
    y = torch.randn(3, 2, 24, 32, 4, dtype=torch.float64)
    left, right = (operator(x) * y).sum(), (x * operator.adjoint(y)).sum()
    torch.testing.assert_close(left, right, rtol=1e-12, atol=1e-12)


def test_gradient_is_the_adjoint():
    mesh = tube(8, 5)
    _, operator = make(mesh, size=(8, 8))
    torch.manual_seed(0)
    x = torch.randn(2, len(mesh.vertices), 2, dtype=torch.float64, requires_grad=True)
    y = torch.randn(2, 2, 8, 8, 2, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad((operator(x) * y.detach()).sum(), x)
    torch.testing.assert_close(gradient, operator.adjoint(y.detach()))
    assert torch.autograd.gradcheck(operator, x)
    assert torch.autograd.gradgradcheck(operator, x)
    assert torch.autograd.gradcheck(operator.adjoint, y)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_batch_equals_its_singles(dtype):
    mesh = tube(20, 12)
    _, operator = make(mesh)
    torch.manual_seed(0)
    batch = torch.randn(2, 3, len(mesh.vertices), 3, dtype=dtype)
    images = operator(batch)
    assert images.shape == (2, 3, 2, 24, 32, 3)
    assert images.dtype == dtype
    back = operator.adjoint(images)
    for a in range(2):
        for b in range(3):
            torch.testing.assert_close(images[a, b], operator(batch[a, b]), rtol=0, atol=1e-6)
            torch.testing.assert_close(back[a, b], operator.adjoint(images[a, b]), rtol=1e-5, atol=1e-5)


def test_autocast_does_not_lower_the_precision():
    mesh = tube(20, 12)
    _, operator = make(mesh)
    vertices = torch.tensor(mesh.vertices, dtype=torch.float32)
    plain = operator(vertices)
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(operator(vertices), plain, rtol=0, atol=0)


def test_moved_operator_gives_the_same():
    mesh = tube(20, 12)
    _, operator = make(mesh)
    vertices = torch.tensor(mesh.vertices)
    moved = operator.to("cpu", torch.float64)
    torch.testing.assert_close(moved(vertices), operator(vertices), rtol=0, atol=0)
    assert torch.equal(moved.mask, operator.mask)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_and_pickles_work(copied):
    mesh = tube(20, 12)
    _, operator = make(mesh)
    vertices = torch.tensor(mesh.vertices)
    images = operator(vertices)
    other = copied(operator)
    torch.testing.assert_close(other(vertices), images, rtol=0, atol=0)
    torch.testing.assert_close(other.adjoint(images), operator.adjoint(images), rtol=0, atol=0)


def test_wrong_shapes_and_types_are_refused():
    _, operator = make(tube(20, 12))
    with pytest.raises(InputError, match="240 values"):
        operator(torch.zeros(239, 3))
    with pytest.raises(InputError, match="images must have shape"):
        operator.adjoint(torch.zeros(2, 32, 24, 3))
    with pytest.raises(TypeError, match="float16"):
        operator(torch.zeros(240, 3, dtype=torch.float16))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("large", [0, 10**9], ids=["frame by frame", "folded"])
def test_frames_one_by_one_and_folded_give_the_same(monkeypatch, device, dtype, large):
    monkeypatch.setattr("render.mesh.sparse._LARGE", large)
    mesh = tube(20, 12)
    raster, operator = make(mesh)
    attributes = np.random.default_rng(1).normal(size=(3, len(mesh.vertices), 6))
    expected = np.stack([by_loop(raster, mesh.faces, frame) for frame in attributes])
    given = torch.tensor(attributes, dtype=dtype, device=device)
    together = given.transpose(0, 1).contiguous().transpose(0, 1)  # all frames of a vertex side by side
    for some in (given, together):
        images = operator(some)
        assert images.device.type == device
        np.testing.assert_allclose(
            images.cpu().numpy(), expected, atol=1e-5 if dtype == torch.float32 else 1e-13
        )
        back = operator.adjoint(images)
        for frame in range(3):
            torch.testing.assert_close(back[frame], operator.adjoint(images[frame]), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_no_frames_and_no_channels_are_fine(dtype):
    _, operator = make(tube(20, 12))
    assert operator(torch.zeros(0, 240, 3, dtype=dtype)).shape == (0, 2, 24, 32, 3)
    assert operator(torch.zeros(2, 240, 0, dtype=dtype)).shape == (2, 2, 24, 32, 0)
    assert operator.adjoint(torch.zeros(0, 2, 24, 32, 3, dtype=dtype)).shape == (0, 240, 3)


@pytest.mark.parametrize("device", DEVICES)
def test_a_stored_raster_is_enough_without_any_gl(tmp_path, monkeypatch, device):
    # What a machine with a GPU and no OpenGL needs: the face ids and weights, from NumPy's rasteriser or from a file.
    monkeypatch.setattr("render.raster.raster.open_context", None)
    mesh = tube(20, 12)
    drawn, operator = make(mesh)
    np.savez(tmp_path / "raster.npz", face_id=drawn.face_id, barycentric=drawn.barycentric, depth=drawn.depth)
    with np.load(tmp_path / "raster.npz") as stored:
        raster = Raster(stored["face_id"], stored["barycentric"], stored["depth"], backend="numpy")
    vertices = torch.tensor(mesh.vertices, dtype=torch.float32, device=device, requires_grad=True)
    images = MapOperator(raster, mesh.faces, len(mesh.vertices)).to(device)(vertices)
    assert torch.equal(images.cpu(), operator(vertices.cpu()))
    (gradient,) = torch.autograd.grad(images.square().sum() / 2, vertices)
    torch.testing.assert_close(gradient, operator.adjoint(images.detach().cpu()).to(device))


def test_single_precision_gradients_are_the_adjoint_too():
    mesh = tube(20, 12)
    _, operator = make(mesh)
    torch.manual_seed(0)
    x = torch.randn(3, len(mesh.vertices), 4, requires_grad=True)
    y = torch.randn(3, 2, 24, 32, 4)
    (gradient,) = torch.autograd.grad((operator(x) * y).sum(), x)
    torch.testing.assert_close(gradient, operator.adjoint(y))
    torch.testing.assert_close((operator(x) * y).sum(), (x * operator.adjoint(y)).sum(), rtol=1e-5, atol=1e-4)
