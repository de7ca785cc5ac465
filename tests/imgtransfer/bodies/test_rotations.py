"""Rotations in stacks: by hand, and laws that hold for every rotation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.rotations import about, between, segment_frame, twist

Z = np.array([0.0, 0, 1])


def some(count, seed=0):
    return Rotation.random(count, random_state=seed).as_matrix()


def angle(rotations):
    return Rotation.from_matrix(rotations).magnitude()


def test_turns_about_an_axis_by_hand():
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(about(Z, np.array([0, np.pi / 2])), [np.eye(3), quarter], atol=1e-15)


@pytest.mark.parametrize("fraction", [0.0, 0.25, 1.0])
def test_between_divides_the_angle(fraction):
    start, end = some(20), some(20, seed=1)
    half = between(start, end, fraction)
    whole = angle(np.swapaxes(start, 1, 2) @ end)
    np.testing.assert_allclose(angle(np.swapaxes(start, 1, 2) @ half), fraction * whole, atol=1e-7)
    np.testing.assert_allclose(angle(np.swapaxes(half, 1, 2) @ end), (1 - fraction) * whole, atol=1e-7)


def test_between_is_the_same_from_both_ends_and_turns_with_the_world():
    start, end, turn = some(20), some(20, seed=1), some(1, seed=2)
    np.testing.assert_allclose(between(start, end, 0.3), between(end, start, 0.7), atol=1e-9)
    np.testing.assert_allclose(
        between(turn @ start, turn @ end, 0.3), turn @ between(start, end, 0.3), atol=1e-9
    )


def test_every_pair_may_have_its_own_fraction():
    start, end = some(6).reshape(2, 3, 3, 3), some(6, seed=1).reshape(2, 3, 3, 3)
    fractions = np.array([[0.0, 0.2, 0.4], [0.6, 0.8, 1.0]])
    mixed = between(start, end, fractions)
    assert mixed.shape == (2, 3, 3, 3)
    for row, column in np.ndindex(2, 3):
        one = between(start[row, column][None], end[row, column][None], fractions[row, column])
        np.testing.assert_allclose(mixed[row, column], one[0], atol=1e-12)
    by_frame = between(start, end, np.array([[0.1], [0.9]]))
    np.testing.assert_allclose(by_frame[1], between(start[1], end[1], 0.9), atol=1e-12)


def test_half_a_half_turn_is_a_quarter_turn():
    half = between(np.eye(3)[None], np.diag([-1.0, -1.0, 1.0])[None], 0.5)
    assert np.abs(half[0] @ [1, 0, 0]) == pytest.approx([0, 1, 0], abs=1e-9)  # whichever way round


def test_the_twist_of_a_swing_is_nothing_and_that_of_a_product_its_own():
    across = np.array([0.6, 0.8, 0.0])  # at right angles to z
    swings, turns = np.linspace(-2.5, 2.5, 11), np.linspace(-1.5, 2.0, 11)
    np.testing.assert_allclose(twist(about(across, swings), Z), 0, atol=1e-12)
    np.testing.assert_allclose(twist(about(across, swings) @ about(Z, turns), Z), turns, atol=1e-12)
    np.testing.assert_allclose(twist(about(across, swings) @ about(Z, turns), -Z), -turns, atol=1e-12)


def test_the_first_frame_decides_between_whole_turns():
    turns = np.array([-3.0, -3.5, -4.0])
    np.testing.assert_allclose(twist(about(Z, turns), Z), turns, atol=1e-12)
    np.testing.assert_allclose(twist(about(Z, turns[1:]), Z), turns[1:] + 2 * np.pi, atol=1e-12)


def test_a_segments_frame_is_right_handed_and_keeps_its_direction():
    direction, hinge = np.array([0.0, -3.0, 0.0]), np.array([1.0, 5.0, 0.0])
    # The hinge loses what lies along the segment: x is left.
    wanted = np.stack([[0, -1, 0], [1, 0, 0], [0, 0, 1]], axis=1)
    np.testing.assert_allclose(segment_frame(direction, hinge), wanted, atol=1e-15)
    for seed in range(5):
        frame = segment_frame(*np.random.default_rng(seed).normal(size=(2, 3)))
        np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1)
