import pytest
import torch

from render import vertex_normals
from render.mesh.normals import VertexNormals
from tests.helpers.example_meshes import random_soup, sphere


def test_vertex_normals_are_weighted_by_area():
    # At vertex 0 a face of area 0.5 facing +z and one of area 1 facing +x meet.
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2]], dtype=torch.float64)
    normals = vertex_normals(vertices, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    expected = torch.tensor([2.0, 0, 1], dtype=torch.float64) / 5**0.5
    torch.testing.assert_close(normals[0], expected)
    torch.testing.assert_close(normals[1], torch.tensor([0.0, 0, 1], dtype=torch.float64))
    torch.testing.assert_close(normals[3], torch.tensor([1.0, 0, 0], dtype=torch.float64))


def test_vertex_normals_of_a_sphere_point_outwards():
    mesh = sphere()
    normals = vertex_normals(torch.tensor(mesh.vertices), torch.tensor(mesh.faces))
    assert (normals * torch.tensor(mesh.vertices) / 0.3).sum(-1).min() > 0.99


def test_vertex_normals_without_area_are_zero_with_finite_gradient():
    vertices = torch.zeros(4, 3, dtype=torch.float64, requires_grad=True)
    normals = vertex_normals(vertices, torch.tensor([[0, 1, 2]]))
    normals.sum().backward()
    assert (normals == 0).all()
    assert torch.isfinite(vertices.grad).all()


def test_vertex_normals_gradient_and_batch():
    mesh = sphere(around=6, along=5)
    faces = torch.tensor(mesh.faces)
    vertices = torch.tensor(mesh.vertices, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: vertex_normals(v, faces), vertices)
    batch = torch.stack([vertices, vertices * torch.tensor([1, 2, 3])])
    for k in range(2):
        torch.testing.assert_close(vertex_normals(batch, faces)[k], vertex_normals(batch[k], faces))


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


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_numbers_do_not_depend_on_layout_or_on_whether_a_gradient_is_wanted(dtype):
    mesh = random_soup(5, 50, 90)
    normals = VertexNormals(mesh.faces, 50)
    vertices = torch.randn(4, 50, 3, dtype=dtype)
    together = vertices.transpose(0, 1).contiguous().transpose(0, 1)  # all frames of a vertex side by side
    expected = normals(vertices)
    assert torch.equal(normals(together), expected)
    assert torch.equal(normals(vertices.clone().requires_grad_()).detach(), expected)
