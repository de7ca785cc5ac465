"""Which vertices of a layer lie against which of another."""

import numpy as np
import pytest

from fusion.layer_links import Links, links_across_seams, links_to_layers, links_to_pieces
from render import Mesh

SIDE = 9


def sheet(height=0.0, *, flip=False, spacing=0.01, shift=0.0):
    """Vertices and faces of a square of SIDE × SIDE vertices that faces +z."""
    y, x = np.mgrid[:SIDE, :SIDE] * spacing + shift
    a = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + SIDE + 1], 1), np.stack([a, a + SIDE + 1, a + SIDE], 1)])
    return np.stack([x.ravel(), y.ravel(), np.full(SIDE**2, height)], 1), faces[:, ::-1] if flip else faces


def joined(*sheets):
    """A mesh of them, and the number of each vertex's sheet."""
    starts = np.arange(len(sheets)) * SIDE**2
    faces = [faces + start for (_, faces), start in zip(sheets, starts, strict=True)]
    mesh = Mesh(np.concatenate([vertices for vertices, _ in sheets]), np.concatenate(faces))
    return mesh, np.repeat(np.arange(len(sheets)), SIDE**2)


def linked(*sheets):
    """The links of the second sheet's vertices to those of the first, (K, 2)."""
    mesh, piece = joined(*sheets)
    return links_to_layers(mesh, piece, piece == 1).pairs


def test_layers_on_each_other_are_linked_to_the_vertices_across_and_none_far_along():
    pairs = linked(sheet(), sheet(0.005))
    assert set(pairs[:, 0]) == set(range(SIDE**2, 2 * SIDE**2))
    np.testing.assert_array_equal(pairs[:, 0] - SIDE**2, pairs[:, 1])  # neighbours lie 63 degrees aside
    pairs = linked(sheet(), sheet(0.009))
    assert np.bincount(pairs[:, 0]).max() == 3
    np.testing.assert_array_equal(pairs[np.unique(pairs[:, 0], return_index=True)[1], 1], np.arange(SIDE**2))


@pytest.mark.parametrize(
    ("height", "flip", "want"),
    [
        (0.006, False, True),
        (-0.006, False, True),
        (0.03, False, False),
        (-0.006, True, True),
        (0.006, True, False),
    ],
    ids=["above", "below", "too far", "back to back", "face to face"],
)
def test_which_layers_lie_against_each_other(height, flip, want):
    """The second sheet faces the other way where it is turned over: below the first, their backs are together."""
    assert (len(linked(sheet(), sheet(height, flip=flip))) > 0) == want


def test_one_flat_sheet_has_no_layers():
    mesh, piece = joined(sheet())
    assert len(links_to_layers(mesh, piece, np.ones(SIDE**2, bool)).pairs) == 0


def test_a_piece_that_faces_itself_is_not_linked_to_itself():
    """Sheets face to face and back to back, but as one piece: the sides of an armpit, or of a flat sleeve."""
    for height in (0.006, -0.006):
        mesh, piece = joined(sheet(), sheet(height, flip=True))
        assert len(links_to_layers(mesh, 0 * piece, piece == 1).pairs) == 0
    mesh, piece = joined(sheet(), sheet(0.005))
    assert len(links_to_layers(mesh, 0 * piece, piece == 1).pairs) == SIDE**2


@pytest.mark.parametrize("sides", [1, 8])
def test_layers_of_one_piece_are_those_that_lie_far_apart_along_the_cloth(sides):
    """A step of 6 mm between two flat parts is no pocket; a bag that is sewn on 8 cm away is."""
    low, faces = sheet()
    high = low + np.array([0.001, 0, 0.006])
    vertices = np.concatenate([low, high])
    edge = SIDE * np.arange(SIDE) + (SIDE - 1 if sides == 8 else 0)
    seam = np.stack([edge[:-1], edge[1:], edge[:-1] + SIDE**2], 1)
    mesh = Mesh(vertices, np.concatenate([faces, faces + SIDE**2, seam]))
    asked = np.arange(2 * SIDE**2) == SIDE**2 + 4 * SIDE  # the left end of the upper sheet's middle row
    pairs = links_to_layers(mesh, np.zeros(2 * SIDE**2, int), asked).pairs
    assert (len(pairs) > 0) == (sides == 8)


def test_a_seam_that_the_mesh_keeps_open_is_linked():
    width = (SIDE - 1) * 0.01
    vertices, faces = sheet()
    mesh, piece = joined((vertices, faces), (vertices + np.array([width, 0, 0]), faces))
    pairs = links_across_seams(mesh, piece, piece == 1).pairs
    np.testing.assert_array_equal(pairs[:, 0], SIDE**2 + SIDE * np.arange(SIDE))
    np.testing.assert_array_equal(pairs[:, 1], SIDE * np.arange(SIDE) + SIDE - 1)
    assert len(links_across_seams(mesh, 0 * piece, piece == 1).pairs) == 0


def test_pieces_of_which_nothing_is_known_are_linked_to_those_of_which_something_is():
    mesh, piece = joined(sheet(), sheet(0.006), sheet(0.012))
    links = links_to_pieces(mesh, piece, np.array([True, False, False]))
    assert set(piece[links.pairs[:, 0]]) == {1, 2}
    assert set(piece[links.pairs[:, 1]]) == {0}
    np.testing.assert_array_equal(links.pairs[::3, 1], np.tile(np.arange(SIDE**2), 2))  # right below, first
    assert len(links_to_pieces(mesh, piece, np.ones(3, bool)).pairs) == 0


def test_fewer_vertices_than_links_are_all_linked():
    mesh, piece = joined(sheet(), sheet(0.006))
    piece[0] = 2  # of which alone something is known
    links = links_to_pieces(mesh, piece, np.array([False, False, True]))
    np.testing.assert_array_equal(links.pairs[:, 1], 0)
    assert len(links.pairs) == 2 * SIDE**2 - 1


def test_stiffness_is_one_over_the_length_and_no_more_than_that_of_a_tenth_of_the_mean_edge():
    vertices = np.array([[0.0, 0, 0], [2.0, 0, 0], [2.0, 1e-9, 0]])
    links = Links.edges_of(Mesh(vertices, np.array([[0, 1, 2]])))
    np.testing.assert_allclose(links.stiffness, [2 / 3, 2 / 3, 10], rtol=1e-6)


def test_links_of_a_vertex_are_together_four_times_as_stiff_as_an_edge():
    mesh, piece = joined(sheet(), sheet(0.01))
    mean = np.linalg.norm(np.diff(mesh.vertices[mesh.edges], axis=1)[:, 0], axis=1).mean()
    links = links_to_pieces(mesh, piece, np.array([True, False]))
    length = np.linalg.norm(mesh.vertices[links.pairs[:, 0]] - mesh.vertices[links.pairs[:, 1]], axis=1)
    np.testing.assert_allclose(links.stiffness * length / mean, 4 / 3)
