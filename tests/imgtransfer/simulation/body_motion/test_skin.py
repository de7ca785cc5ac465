import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.simulation.body_motion.skin import SkinPoints, covered_skin, step_count
from imgtransfer.simulation.config import SolverConfig

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip
SKIN = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
SOLVER = SolverConfig(step_length=0.004, min_substeps=2, max_substeps=10)


def count(way, earlier=None):
    """Substeps where the skin moves by `way`, after it moved by `earlier` in the frame before."""
    earlier = np.zeros(3) if earlier is None else earlier
    return step_count(SKIN - earlier, SKIN, SKIN + way, SOLVER)


def test_a_resting_body_and_one_that_moves_evenly_take_the_least():
    assert count(0.0) == 2
    even = np.array([0.05, 0.02, 0])  # 1.6 m/s
    assert count(even, even) == 2


def test_one_moving_vertex_by_hand():
    way = np.zeros((4, 3))
    way[1] = [0, 0.032, 0]  # the mean is 8 mm, so it moves 24 mm apart from it: six steps of 4 mm
    assert count(way, way.mean(axis=0)) == 6
    assert count(way / 2, way.mean(axis=0) / 2) == 3
    assert count(10 * way, 10 * way.mean(axis=0)) == 10


def test_a_jerk_of_the_whole_body_counts():
    assert count(np.array([0.02, 0, 0]), np.array([-0.008, 0, 0])) == 7  # 28 mm a frame of change


def test_the_skin_under_a_garment():
    cloth = np.array([[0.1, 0.05, 0], [0, 0.12, 0]])
    assert np.array_equal(covered_skin(cloth, SKIN), [1, 2])
    assert np.array_equal(covered_skin(cloth + 10, SKIN), np.arange(4))


def test_the_second_attempt_has_twice_the_substeps():
    finer = SOLVER.finer()
    assert (finer.step_length, finer.min_substeps, finer.max_substeps) == (0.002, 4, 20)
    with pytest.raises(ValueError, match="more than max_substeps"):
        SolverConfig(min_substeps=30, max_substeps=20)


def test_points_ride_rigidly_on_the_skin():
    points = np.array([[0.5, 0.5, 1.02], [1.01, 0.2, 0.3]])
    pinned = SkinPoints(points, CUBE, CUBE_FACES)
    np.testing.assert_allclose(pinned.at(CUBE), points, atol=1e-6)
    turn = Rotation.from_rotvec([0.4, 1.0, -0.2])
    frames = np.stack([turn.apply(CUBE) + 3, 2 * CUBE])
    moved = pinned.at(frames)
    np.testing.assert_allclose(moved[0], turn.apply(points) + 3, atol=1e-6)
    # Where the skin grows, its points go apart and keep their distance from it.
    np.testing.assert_allclose(moved[1], [[1.0, 1.0, 2.02], [2.01, 0.4, 0.6]], atol=1e-6)
    assert SkinPoints(np.zeros((0, 3)), CUBE, CUBE_FACES).at(frames).shape == (2, 0, 3)
