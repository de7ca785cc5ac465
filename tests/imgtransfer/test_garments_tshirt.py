import numpy as np
import pytest
import torch

from fusion import BodySdf
from imgtransfer.bodies.anny import load_body
from imgtransfer.garments.cutting import border_edges, border_loops, cut_at_zero, largest_component
from imgtransfer.garments.tshirt import TShirtConfig, make_tshirt
from render import InputError
from render.mesh import Mesh


@pytest.fixture(scope="module")
def body():
    return load_body()


@pytest.fixture(scope="module")
def shirt(body):
    return make_tshirt(body)


def distances(body, points):
    sdf = BodySdf(body.faces, len(body.rest))
    sdf.update(body.rest)
    return sdf.distance(torch.from_numpy(points)).numpy()


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


def test_it_is_one_manifold_piece_with_four_openings(shirt):
    halves = shirt.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len(np.unique(halves, axis=0)) == len(halves)  # consistently wound, no edge with three faces
    assert len(largest_component(shirt).vertices) == len(shirt.vertices)
    loops = border_loops(shirt.faces)
    assert len(loops) == 4
    on_loops = np.concatenate(loops)
    assert len(np.unique(on_loops)) == len(on_loops)  # no border touches another or itself
    assert len(shirt.vertices) - len(shirt.edges) + len(shirt.faces) == -2  # a sphere with four holes
    assert len(np.unique(shirt.vertices.round(6), axis=0)) == len(shirt.vertices)
    assert 1700 < len(shirt.vertices) < 2300


def test_the_openings_are_hem_neck_and_sleeves(shirt):
    hem, *others = (shirt.vertices[loop].mean(axis=0) for loop in border_loops(shirt.faces))
    assert hem[1] < min(other[1] for other in others)
    left, neck, right = sorted(others, key=lambda centre: -centre[0])
    assert left[0] > 0.2 > abs(neck[0]) + 0.15
    assert right[0] < -0.2
    assert neck[1] > left[1]


def test_it_lies_outside_the_body_with_even_triangles(body, shirt):
    clearance = distances(body, shirt.vertices)
    assert clearance.min() > 0.008
    assert np.median(clearance) == pytest.approx(0.022, abs=0.006)
    lengths = np.linalg.norm(np.diff(shirt.vertices[shirt.edges], axis=1)[:, 0], axis=-1)
    assert np.median(lengths) == pytest.approx(0.0192, rel=0.05)
    assert lengths.max() / lengths.min() < 5
    corners = shirt.vertices[shirt.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    cosine = -np.einsum("fij,fij->fi", sides, np.roll(sides, 1, axis=1)) / (
        np.linalg.norm(sides, axis=-1) * np.linalg.norm(np.roll(sides, 1, axis=1), axis=-1)
    )
    assert np.degrees(np.arccos(cosine)).min() > 15


def test_normals_point_away_from_the_body(body, shirt):
    corners = shirt.vertices[shirt.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centres = corners.mean(axis=1)
    assert (distances(body, centres + 0.005 * normals) > distances(body, centres)).mean() > 0.98


def test_sizes_act(body, shirt):
    coarse = make_tshirt(body, TShirtConfig(edge_length=0.03, ease=0.03, hem=0.0, sleeve=0.4))
    assert len(coarse.vertices) < 0.6 * len(shirt.vertices)
    assert coarse.vertices[:, 1].min() > shirt.vertices[:, 1].min() + 0.03
    assert coarse.vertices[:, 0].max() < shirt.vertices[:, 0].max()
    assert np.median(distances(body, coarse.vertices)) > np.median(distances(body, shirt.vertices)) + 0.004


def test_it_is_the_same_every_time(body, shirt):
    assert np.array_equal(make_tshirt(body).vertices, shirt.vertices)


def test_sizes_that_leave_no_shirt_are_refused(body):
    with pytest.raises(InputError, match="openings"):
        make_tshirt(body, TShirtConfig(ease=0.09, flare=0.49))


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
