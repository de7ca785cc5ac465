"""Errors and strain as numbers on faces, and as levels of colour."""

from __future__ import annotations

import numpy as np
import pytest

from imgtransfer.viewing.colours import LEVELS, Strain, error_mm, levels, round_limit
from render import Mesh

# Two triangles that make a unit square.
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_the_error_of_a_face_is_its_corners_mean_in_millimetres() -> None:
    moved = SQUARE.copy()
    moved[1, 2] = 0.006
    moved[2, 0] += 0.003
    np.testing.assert_allclose(error_mm(moved, SQUARE, FACES), [3.0, 1.0])


def test_strain_is_the_largest_change_of_the_three_edges() -> None:
    strain = Strain(Mesh(SQUARE, FACES))
    assert strain.percent(SQUARE) == pytest.approx([0.0, 0.0])
    wide = SQUARE * [1.1, 1.0, 1.0]  # the diagonal becomes sqrt(1.21 + 1) from sqrt(2), 5.1 % more
    assert strain.percent(wide) == pytest.approx([10.0, 10.0])
    narrow = SQUARE * [0.8, 1.0, 1.0]
    assert strain.percent(narrow) == pytest.approx([20.0, 20.0])


def test_strain_ignores_rigid_motion() -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    moved = SQUARE @ turn.T + [3, 4, 5]
    assert Strain(Mesh(SQUARE, FACES)).percent(moved) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_an_edge_without_length_at_rest_gives_a_level_and_no_warning() -> None:
    flat = SQUARE.copy()
    flat[1] = flat[0]
    values = Strain(Mesh(flat, FACES)).percent(SQUARE)
    assert levels(values, 10.0)[0] == LEVELS - 1


def test_levels_begin_at_0_and_end_at_the_limit() -> None:
    values = np.array([0.0, 0.999, 1.0, 15.99, 16.0, 1e9, np.inf, np.nan])
    assert levels(values, 16.0).tolist() == [0, 0, 1, 15, 15, 15, 15, 0]


@pytest.mark.parametrize(
    ("top", "limit"), [(0.0, 1.0), (0.9, 1.0), (4.2, 5.0), (17.0, 20.0), (830.0, 1000.0)]
)
def test_the_scale_ends_at_a_round_number(top: float, limit: float) -> None:
    assert round_limit(np.full(100, top)) == pytest.approx(limit)


def test_there_is_a_scale_for_no_values_at_all() -> None:
    assert round_limit(np.zeros(0)) == 1.0
