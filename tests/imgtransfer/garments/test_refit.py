"""A tube of cloth carried from one cylinder to another."""

from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.garments.field import Field
from imgtransfer.garments.finish import relaxed
from imgtransfer.garments.refit import refitted
from render.mesh.mesh import Mesh
from tests.helpers import synthetic
from tests.helpers.figures import figure_of, trunk

CELL, RINGS, SIDES = 0.02, 9, 24
BODY, CLOTH = 0.15, 0.18  # radii


def tube():
    vertices, faces = synthetic.tube(CLOTH, 0.4, RINGS, SIDES, closed=False)
    return Mesh(vertices.astype(float), faces, "tube")


def around(radius, shift=(0, 0, 0)):
    """The distance to an upright cylinder of cloth, on a grid that lies alike about each of them."""
    grid = Field(np.zeros((25, 41, 25)), np.array([-0.24, -0.2, -0.24]) + shift, CELL)
    across = grid.points[..., [0, 2]] - np.array(shift)[[0, 2]]
    return grid.with_values(np.linalg.norm(across, axis=-1) - radius)


def borders(lower, upper):
    rows = np.arange(RINGS * SIDES).reshape(RINGS, SIDES)
    return [(rows[0], lower), (rows[-1], upper)]


@pytest.fixture(scope="module")
def figure():
    return figure_of(trunk(BODY))


def test_a_body_that_is_moved_takes_its_garment_along(figure):
    shift = np.array([0.3, 0.1, -0.2])
    moved = replace(figure, vertices=figure.vertices + shift)
    mesh = tube()
    after = refitted(mesh, figure, moved, around(CLOTH, shift), borders(None, None))
    assert after.faces is mesh.faces
    assert after.source == "tube"
    np.testing.assert_allclose(after.vertices, relaxed(mesh, around(CLOTH)) + shift, atol=1e-9)


def test_a_wider_body_widens_the_garment_and_heights_stay(figure):
    wide = replace(figure, vertices=figure.vertices * [1.2, 1, 1.2])
    after = refitted(tube(), figure, wide, around(0.21), borders(None, None)).vertices
    np.testing.assert_allclose(np.hypot(after[:, 0], after[:, 2]), 0.21, atol=5e-4)
    np.testing.assert_allclose(after[:, 1], tube().vertices[:, 1], atol=1e-6)
    angle = np.arctan2(after[:, 0], after[:, 2]) - np.arctan2(tube().vertices[:, 0], tube().vertices[:, 2])
    assert (
        np.abs((angle + np.pi) % (2 * np.pi) - np.pi).max() < 0.05
    )  # a fifth of a column: the nearest skin is not symmetric


def test_borders_come_to_their_heights_and_the_rest_is_spread_evenly(figure):
    after = refitted(tube(), figure, figure, around(CLOTH), borders(0.02, 0.5)).vertices
    rows = after[:, 1].reshape(RINGS, SIDES)
    # On an even tube what is harmonic is linear from row to row.
    np.testing.assert_allclose(
        rows, np.repeat(np.linspace(0.02, 0.5, RINGS)[:, None], SIDES, axis=1), atol=1e-6
    )
    np.testing.assert_allclose(rows[[0, -1]], [[0.02] * SIDES, [0.5] * SIDES], atol=1e-12)


def test_a_border_without_a_height_stays_while_the_other_one_moves(figure):
    after = refitted(tube(), figure, figure, around(CLOTH), borders(None, 0.48)).vertices
    rows = after[:, 1].reshape(RINGS, SIDES)
    np.testing.assert_allclose(rows[0], 0, atol=1e-6)
    np.testing.assert_allclose(rows[4], 0.24, atol=1e-6)  # half of the lift, in the middle row
