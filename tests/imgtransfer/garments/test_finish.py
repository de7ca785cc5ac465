"""From a field to an even mesh with openings."""

import numpy as np
import pytest

from imgtransfer.garments.cutting import border_edges, border_loops
from imgtransfer.garments.field import Field
from imgtransfer.garments.finish import cut_surface, relaxed
from render.mesh.mesh import Mesh
from tests.helpers import synthetic

CELL = 0.02
RADIUS = 0.2


def round_field(*, upright=False):
    """The distance to a ball around the origin, or to an upright cylinder."""
    grid = Field(np.zeros((29, 29, 29)), np.full(3, -0.28), CELL)
    points = grid.points[..., [0, 2]] if upright else grid.points
    return grid.with_values(np.linalg.norm(points, axis=-1) - RADIUS)


def lengths(mesh, vertices=None):
    points = mesh.vertices if vertices is None else vertices
    return np.linalg.norm(points[mesh.edges[:, 1]] - points[mesh.edges[:, 0]], axis=1)


def test_a_cylinder_cut_twice_is_an_even_band():
    cuts = [lambda points: points[:, 1] - 0.1, lambda points: -0.12 - points[:, 1]]
    mesh = cut_surface(round_field(upright=True), cuts, 0.04, "a band")
    assert mesh.source == "a band"
    loops = border_loops(mesh.faces)
    assert len(loops) == 2
    heights = sorted(mesh.vertices[loop, 1].mean() for loop in loops)
    np.testing.assert_allclose(heights, [-0.12, 0.1], atol=0.004)
    np.testing.assert_allclose(np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2]), RADIUS, atol=0.001)
    edges = lengths(mesh)
    assert np.median(edges) == pytest.approx(0.04, rel=0.1)
    assert edges.std() / edges.mean() < 0.2


def test_of_what_a_cut_leaves_the_largest_piece_stays():
    mesh = cut_surface(round_field(), [lambda points: 0.05 - np.abs(points[:, 1] - 0.06)], 0.04, "a bowl")
    assert mesh.vertices[:, 1].max() < 0.02  # without the cap beyond the cut
    assert len(border_loops(mesh.faces)) == 1


def even_tube():
    """A tube on the cylinder, rows and columns."""
    vertices, faces = synthetic.tube(RADIUS, 0.4, 9, 24, closed=False)
    return Mesh(vertices.astype(float) - [0, 0.2, 0], faces, "tube")


def uneven_tube():
    """The same after its inner vertices slid along the cylinder, and those of its borders around it."""
    points = even_tube().vertices
    random = np.random.default_rng(0)
    angle = np.arctan2(points[:, 0], points[:, 2]) + random.uniform(-0.06, 0.06, len(points))
    height = points[:, 1] + random.uniform(-0.01, 0.01, len(points)) * (np.abs(points[:, 1]) < 0.199)
    return Mesh(
        np.stack([RADIUS * np.sin(angle), height, RADIUS * np.cos(angle)], axis=1), even_tube().faces, "tube"
    )


def test_relaxing_evens_out_and_stays_on_the_surface_and_the_borders_line():
    mesh = uneven_tube()
    after = relaxed(mesh, round_field(upright=True))
    even = lengths(even_tube())
    assert (lengths(mesh, after) - even).std() < 0.5 * (lengths(mesh) - even).std()
    np.testing.assert_allclose(np.hypot(after[:, 0], after[:, 2]), RADIUS, atol=3e-4)
    border = np.unique(border_edges(mesh.faces))
    assert len(border) == 48
    np.testing.assert_allclose(after[border, 1], mesh.vertices[border, 1], atol=1e-12)
    around = np.diff(np.unwrap(np.arctan2(after[:24, 0], after[:24, 2])))  # the lower border
    before = np.diff(np.unwrap(np.arctan2(mesh.vertices[:24, 0], mesh.vertices[:24, 2])))
    assert around.std() < 0.5 * before.std()


def test_relaxing_follows_a_renumbering_of_the_vertices():
    mesh, field = uneven_tube(), round_field(upright=True)
    order = np.random.default_rng(1).permutation(len(mesh.vertices))
    renumbered = Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces], "tube")
    np.testing.assert_allclose(relaxed(renumbered, field), relaxed(mesh, field)[order], atol=1e-12)


def test_an_even_tube_stays():
    mesh = even_tube()
    assert np.abs(relaxed(mesh, round_field(upright=True)) - mesh.vertices).max() < 1e-3
