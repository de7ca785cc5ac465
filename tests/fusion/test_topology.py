"""What is constant over a template, against loops over its edges and faces."""

import numpy as np
import pytest
import torch

from fusion import Topology
from fusion.topology import vertices_first
from render import Mesh
from tests.helpers.example_meshes import two_quads, two_triangles

SQUARE = two_triangles()
MESHES = {"a square": SQUARE, "two squares": two_quads()}


@pytest.mark.parametrize("name", MESHES)
def test_edges_are_differences_of_their_ends_with_the_template_s_lengths(name):
    mesh, topology = MESHES[name], Topology(MESHES[name])
    vertices = torch.from_numpy(np.random.default_rng(0).normal(size=(2, *mesh.vertices.shape)))
    found = topology.difference(vertices)
    for edge, (i, j) in enumerate(mesh.edges):
        torch.testing.assert_close(found[:, edge], vertices[:, i] - vertices[:, j], rtol=0, atol=0)
        assert topology.rest_lengths[edge] == np.linalg.norm(mesh.vertices[i] - mesh.vertices[j])
    assert (topology.n_vertices, topology.n_edges) == (len(mesh.vertices), len(mesh.edges))


def test_lengths_of_a_unit_square_by_hand():
    """Edges 01, 02 (the diagonal), 03, 12, 23."""
    assert Topology(SQUARE).rest_lengths.tolist() == [1, 2**0.5, 1, 1, 1]


def test_adjacency_sums_over_neighbours():
    """The diagonal's ends, 0 and 2, have three neighbours each, the others two; an inner edge counts once."""
    values = torch.tensor([[1.0], [10.0], [100.0], [1000.0]])
    assert Topology(SQUARE).adjacency(values)[:, 0].tolist() == [1110, 101, 1011, 101]


def test_normals_are_weighted_by_area():
    """At vertex 0 a face of 0.5 m² facing +z meets one of 1 m² facing +x."""
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2]]), np.array([[0, 1, 2], [0, 2, 3]]))
    normals = Topology(mesh).normals(torch.from_numpy(mesh.vertices))
    want = torch.tensor([[2.0, 0, 1], [0, 0, 1], [2, 0, 1], [1, 0, 0]], dtype=torch.float64)
    torch.testing.assert_close(normals, want / want.norm(dim=-1, keepdim=True))


def test_normals_follow_the_vertices_and_not_the_template():
    topology, vertices = Topology(SQUARE), torch.from_numpy(SQUARE.vertices)
    upright = vertices[:, [0, 2, 1]]  # in the plane of x and z, where it faces down
    assert topology.normals(upright).tolist() == [[0, -1, 0]] * 4
    mirrored = vertices * torch.tensor([-1.0, 1, 1])
    assert topology.normals(torch.stack([vertices, mirrored]))[:, :, 2].tolist() == [[1] * 4, [-1] * 4]


def test_the_order_of_the_faces_and_of_their_corners_does_not_matter():
    mesh = two_quads()
    turned = Mesh(mesh.vertices, np.roll(mesh.faces[::-1], 1, axis=1))
    moved = torch.from_numpy(np.random.default_rng(1).normal(size=mesh.vertices.shape))
    torch.testing.assert_close(Topology(turned).normals(moved), Topology(mesh).normals(moved))
    np.testing.assert_array_equal(Topology(turned).edges, Topology(mesh).edges)


def test_faces_without_area_and_vertices_without_face_have_no_normal_and_finite_gradients():
    mesh = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 5, 5], [5, 5, 5]]), np.array([[0, 1, 2], [3, 3, 4]])
    )
    topology = Topology(mesh)
    vertices = torch.from_numpy(mesh.vertices).requires_grad_()
    normals = topology.normals(vertices)
    normals.sum().backward()
    assert torch.equal(normals, torch.zeros(5, 3, dtype=torch.float64))
    assert torch.isfinite(vertices.grad).all()
    assert topology.rest_lengths.tolist() == [1, 2, 1, 0, 0]  # 01, 02, 12, 33, 34


def test_gradient_of_the_normals():
    topology = Topology(SQUARE)
    vertices = torch.from_numpy(SQUARE.vertices + np.random.default_rng(2).normal(0, 0.1, (2, 4, 3)))
    assert torch.autograd.gradcheck(topology.normals, (vertices.requires_grad_(),))


def test_vertices_first_are_the_same_numbers_side_by_side():
    frames = torch.arange(24.0).reshape(2, 4, 3)
    found = vertices_first(frames)
    assert torch.equal(found, frames)
    assert found.transpose(0, 1).is_contiguous()
    assert vertices_first(frames[:0]).shape == (0, 4, 3)
