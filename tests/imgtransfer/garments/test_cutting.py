import numpy as np
import pytest

from imgtransfer.garments.cutting import (
    border_edges,
    border_loops,
    components,
    cut_at_zero,
    largest_component,
    without_pinches,
)
from render.mesh.mesh import Mesh


def sheet(columns, rows):
    """A flat grid of right triangles in the plane z = 0, counter-clockwise seen from +z."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    corner = np.arange(columns)[None] + (columns + 1) * np.arange(rows)[:, None]
    a, b, c, d = (
        corner.ravel(),
        corner.ravel() + 1,
        corner.ravel() + columns + 2,
        corner.ravel() + columns + 1,
    )
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def test_a_cut_follows_the_line_and_keeps_triangles_whole():
    mesh = sheet(10, 4)
    cut = cut_at_zero(mesh, mesh.vertices[:, 0] - 6.3)
    assert cut.vertices[:, 0].max() == pytest.approx(6.3)
    assert (cut.vertices[:, 0] == 6.3).sum() == 5  # a straight border: one vertex a row
    assert len(cut.faces) == 2 * 6 * 4
    corners = cut.vertices[cut.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert areas.min() > 0.4
    # At the sheet's own border a vertex may move along a diagonal, which takes a corner of a triangle.
    assert areas.sum() == pytest.approx(6.3 * 4, rel=0.01)


def test_borders_of_a_sheet_and_parts_of_two():
    mesh = sheet(3, 2)
    assert len(border_edges(mesh.faces)) == 10
    assert [len(loop) for loop in border_loops(mesh.faces)] == [10]
    two = Mesh(
        np.concatenate([mesh.vertices, sheet(1, 1).vertices + 20]),
        np.concatenate([mesh.faces, sheet(1, 1).faces + len(mesh.vertices)]),
    )
    assert np.array_equal(largest_component(two).faces, mesh.faces)
    assert components(two) == 2
    assert components(mesh) == 1


def test_a_pinch_loses_its_smaller_side():
    # Around the middle of a hexagon, three faces on one side and one on the other.
    angles = np.pi / 3 * np.arange(6)
    points = np.concatenate([[[0, 0, 0]], np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)])
    pinched = Mesh(points, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 5, 6]]))
    whole = without_pinches(pinched)
    assert whole.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert np.array_equal(whole.vertices, points[:5])
    assert without_pinches(whole) is whole
