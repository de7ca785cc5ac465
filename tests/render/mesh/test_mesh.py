import numpy as np
import pytest
import torch

from render import InputError, Mesh, vertex_normals
from render.mesh.mesh import check_finite
from tests.helpers.example_meshes import sphere, two_triangles

SQUARE = two_triangles()


def test_edges_by_hand():
    assert SQUARE.edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE.vertices, np.zeros((0, 3), int), "no faces"),
        (SQUARE.vertices, [[0, 1, 4]], r"face 0 uses vertices \[0, 1, 4\]"),
        (SQUARE.vertices, [[0, 1, 2], [0, 1, -1]], "face 1 uses"),
        (SQUARE.vertices, [[0.0, 1.0, 2.0]], "integers"),
        (SQUARE.vertices, [[0, 1, 2, 3]], r"\(F, 3\)"),
        (SQUARE.vertices[:, :2], [[0, 1, 2]], r"\(N, 3\)"),
        ([[0, 0, 0], [1, 0, np.inf], [0, 1, 0]], [[0, 1, 2]], "vertex 1 is .* not finite"),
    ],
)
def test_unusable_meshes_are_refused(vertices, faces, message):
    with pytest.raises(InputError, match=message) as caught:
        Mesh(np.array(vertices), np.array(faces), source="shirt.obj")
    assert str(caught.value).startswith("shirt.obj: ")
    assert "\n" not in str(caught.value)


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


@pytest.mark.parametrize(
    ("value", "wrong"), [(np.nan, "not finite"), (-np.inf, "not finite"), (1e30, "beyond ±10000 m")]
)
def test_a_vertex_that_cannot_be_meant_is_named_with_its_frame(value, wrong):
    moved = np.zeros((3, 4, 3), np.float32)
    check_finite(moved, "shirt")
    moved[1, 2, 0] = value
    with pytest.raises(InputError, match=rf"shirt: frame 41, vertex 2 is .* {wrong} \(1 such vertices\)"):
        check_finite(moved, "shirt", first=40)
