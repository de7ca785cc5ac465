import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from render.mesh import heading, rigid_rotation, twist_angle

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
Y = np.array([0.0, 1.0, 0.0])


def kabsch(start, end):
    """The definition by singular values, as Kabsch (1976) gives it."""
    left, _, right = np.linalg.svd((end - end.mean(0)).T @ (start - start.mean(0)))
    return left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right


def test_a_quarter_turn_about_z_by_hand():
    turned = np.stack([-CUBE[:, 1], CUBE[:, 0], CUBE[:, 2]], axis=1) + np.array([5.0, 0, 0])
    np.testing.assert_allclose(rigid_rotation(CUBE, turned), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


@pytest.mark.parametrize("count", [3, 8, 500])
def test_equals_the_definition_among_noise(count):
    random = np.random.default_rng(count)
    for _ in range(20):
        start = random.normal(size=(count, 3))
        turn = Rotation.random(random_state=random.integers(1 << 30)).as_matrix()
        end = start @ turn.T + random.normal(size=3) + 0.2 * random.normal(size=(count, 3))
        np.testing.assert_allclose(rigid_rotation(start, end), kabsch(start, end), atol=1e-12)


def test_no_other_rotation_fits_better():
    random = np.random.default_rng(0)
    start, end = random.normal(size=(2, 30, 3))
    start, end = start - start.mean(0), end - end.mean(0)

    def error(turn):
        return np.square(start @ turn.T - end).sum()

    best = error(rigid_rotation(start, end))
    for rotation in Rotation.random(200, random_state=1).as_matrix():
        assert error(rotation) >= best


def test_a_point_that_counts_three_times_stands_for_three():
    random = np.random.default_rng(4)
    start, end = random.normal(size=(2, 6, 3))
    thrice = np.r_[0, 0, 0, 1:6]
    weights = np.array([3, 1, 1, 1, 1, 1]) / 8
    np.testing.assert_allclose(
        rigid_rotation(start, end, weights), rigid_rotation(start[thrice], end[thrice]), atol=1e-12
    )


def test_a_mirror_image_gets_a_rotation():
    mirrored = rigid_rotation(CUBE, CUBE * [-1, 1, 1])
    assert np.linalg.det(mirrored) == pytest.approx(1)


def test_a_flat_mesh_gets_the_rotation_that_turns_its_plane():
    plane = CUBE * [1, 1, 0]
    turn = Rotation.from_rotvec([0.4, -0.3, 1.1]).as_matrix()
    np.testing.assert_allclose(rigid_rotation(plane, plane @ turn.T), turn, atol=1e-12)


@pytest.mark.parametrize("points", [CUBE * [1, 0, 0], np.ones((4, 3))], ids=["on a line", "at one place"])
def test_points_that_leave_the_rotation_open_get_one_without_a_warning(points):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(rigid_rotation(points, points), np.eye(3), atol=1e-12)
        turned = rigid_rotation(points, points[:, [1, 0, 2]])
    assert np.linalg.det(turned) == pytest.approx(1)
    np.testing.assert_allclose((points - points.mean(0)) @ turned.T, (points - points.mean(0))[:, [1, 0, 2]])


def test_twist_by_hand():
    # 0.7 about y after 0.3 about x: the swing about x has no part in the twist about y.
    both = Rotation.from_rotvec([0, 0.7, 0]) * Rotation.from_rotvec([0.3, 0, 0])
    assert twist_angle(both.as_matrix(), Y) == pytest.approx(0.7)
    assert twist_angle(both.inv().as_matrix()[None], Y) == pytest.approx([-0.7])


def test_heading_is_a_turn_about_the_vertical_whatever_the_rotation():
    rotations = Rotation.random(50, random_state=0).as_matrix()
    turns = heading(rotations)
    np.testing.assert_allclose(turns @ Y, np.tile(Y, (50, 1)), atol=1e-12)
    further = Rotation.from_rotvec([0, 0.7, 0]).as_matrix()
    np.testing.assert_allclose(heading(further @ rotations), further @ turns, atol=1e-9)


def test_a_heading_alone_equals_that_in_a_batch():
    rotations = Rotation.random(5, random_state=3).as_matrix()
    for rotation, turn in zip(rotations, heading(rotations), strict=True):
        np.testing.assert_array_equal(heading(rotation), turn)


def test_a_body_upside_down_has_the_identity_as_heading():
    upside_down = np.diag([-1.0, -1.0, 1.0])[None]  # half a turn about z
    np.testing.assert_allclose(heading(upside_down)[0], np.eye(3), atol=1e-9)
