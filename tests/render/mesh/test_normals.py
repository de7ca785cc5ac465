import pytest
import torch

from render import vertex_normals
from render.mesh.normals import VertexNormals
from tests.helpers.example_meshes import random_soup, sphere


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_equal_those_without_anything_kept(dtype, batch):
    mesh = random_soup(3, 40, 60)
    vertices = torch.randn(*batch, 40, 3, dtype=dtype)
    expected = vertex_normals(vertices, torch.tensor(mesh.faces))
    torch.testing.assert_close(VertexNormals(mesh.faces, 40)(vertices), expected)


def test_by_hand_and_without_area():
    # One face in the x-y plane, one without area, and a vertex that no face uses.
    normals = VertexNormals(torch.tensor([[0, 1, 2], [3, 3, 0]]).numpy(), 5)
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 6, 6]], requires_grad=True)
    found = normals(vertices)
    assert found.tolist() == [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 0, 0]]
    found.square().sum().backward()
    assert torch.isfinite(vertices.grad).all()


def test_gradient():
    mesh = sphere(around=6, along=5)
    normals = VertexNormals(mesh.faces, len(mesh.vertices))
    assert torch.autograd.gradcheck(normals, torch.tensor(mesh.vertices, requires_grad=True))
