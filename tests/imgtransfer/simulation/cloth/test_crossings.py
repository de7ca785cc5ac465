"""Edges that pass through triangles, on meshes of which every pair is known."""

import numpy as np
import pytest
from imgtransfer.simulation.cloth.crossings import crossings

from render.mesh.mesh import Mesh

FLAT = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
FACES = np.array([[0, 1, 2], [3, 4, 5]])


def found(second):
    """The edges of the flat triangle and of a second one that cross the other, as pairs of vertices."""
    points = np.array(FLAT + second, float)
    mesh = Mesh(points, FACES)
    marks = crossings(mesh, points[None])
    assert marks.shape == (1, 6)
    return {tuple(edge) for edge in mesh.edges[marks[0]].tolist()}


@pytest.mark.parametrize(("second", "wanted"), [
    ([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1]], {(3, 4), (3, 5)}),  # a tip through the middle
    ([[0.2, 0.2, -1], [0.2, 0.2, 1], [3, 3, 1]], {(3, 4), (1, 2)}),  # each one's edge through the other
    ([[0.2, 0.2, 0.1], [0.3, 0.2, 1], [0.2, 0.3, 1]], set()),  # above it
    ([[2, 2, -1], [2.1, 2, 1], [2, 2.1, 1]], set()),  # through its plane only
    ([[0.2, 0.2, 0], [0.4, 0.2, 0], [0.2, 0.4, 0]], set()),  # in its plane
    ([[0.2, 0.2, 0], [0.3, 0.2, 1], [0.2, 0.3, 1]], set()),  # a tip that only touches
    ([[0.3, 0.3, -1], [0.3, 0.3, -1], [0.3, 0.3, 1]], {(3, 5), (4, 5)}),  # a triangle that is a line still pierces
])  # fmt: skip
def test_pairs_of_triangles_by_hand(second, wanted):
    assert found(second) == wanted


def test_neighbours_in_a_corner_do_not_count():
    points = np.array([*FLAT, [0.5, 0.2, -1], [0.5, 0.2, 1]], float)
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 3, 4]]))
    marks = crossings(mesh, points[None])[0]
    # The side opposite to the common corner passes through; the two that begin there do not.
    assert mesh.edges[marks].tolist() == [[3, 4]]


def test_each_frame_is_looked_at_by_itself_and_rigid_motion_changes_nothing():
    through, above = ([[0.2, 0.2, low], [0.3, 0.2, low + 1], [0.2, 0.3, low + 1]] for low in (-0.5, 0.5))
    mesh = Mesh(np.array(FLAT + above, float), FACES)
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    frames = np.array([FLAT + above, FLAT + through, FLAT + above])
    frames = np.concatenate([frames, frames[1:2] @ turn.T + [3.0, -2.0, 1.0]])
    marks = crossings(mesh, frames)
    assert marks.any(axis=1).tolist() == [False, True, False, True]
    assert np.array_equal(marks[1], marks[3])


def test_no_frames_have_no_crossings():
    mesh = Mesh(np.array(FLAT + FLAT, float) + np.arange(6)[:, None], FACES)
    assert crossings(mesh, np.zeros((0, 6, 3))).shape == (0, 6)
