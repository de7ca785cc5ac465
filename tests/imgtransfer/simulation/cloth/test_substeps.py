import numpy as np
import pytest

from imgtransfer.simulation.cloth.substeps import skin_under, step_count
from imgtransfer.simulation.config import SolverConfig

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
    assert np.array_equal(skin_under(cloth, SKIN), [1, 2])
    assert np.array_equal(skin_under(cloth + 10, SKIN), np.arange(4))


def test_the_second_attempt_has_twice_the_substeps():
    finer = SOLVER.finer()
    assert (finer.step_length, finer.min_substeps, finer.max_substeps) == (0.002, 4, 20)
    with pytest.raises(ValueError, match="more than max_substeps"):
        SolverConfig(min_substeps=30, max_substeps=20)
