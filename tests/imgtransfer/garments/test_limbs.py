"""Places along chains of joints, and which points belong to an arm."""

from itertools import pairwise

import numpy as np
import pytest

from imgtransfer.garments.limbs import along_chain, on_arms
from tests.helpers.figures import standing_joints

CHAIN = np.array([[0, 0, 0], [2, 0, 0], [2, -3, 0]], float)  # 2 to the right, then 3 down


@pytest.mark.parametrize(("point", "along", "offset"), [
    ([1, 0.5, 0], 1, [0, 0.5, 0]),
    ([-1, 0, 1], 0, [-1, 0, 1]),  # before the start
    ([2.5, -2, 0], 4, [0.5, 0, 0]),
    ([2, -7, 0], 5, [0, -4, 0]),  # past the end
    ([2, 0, 0], 2, [0, 0, 0]),  # on the joint between
])  # fmt: skip
def test_a_point_seen_from_a_chain_by_hand(point, along, offset):
    position, apart, distance = along_chain(CHAIN, np.array([point], float))
    assert position[0] == pytest.approx(along)
    np.testing.assert_allclose(apart[0], offset, atol=1e-12)
    assert distance[0] == pytest.approx(np.linalg.norm(offset))


def test_the_nearest_place_is_that_of_a_fine_search():
    random = np.random.default_rng(1)
    chain, points = random.normal(size=(4, 3)), random.normal(size=(30, 3))
    fine = np.concatenate([np.linspace(a, b, 2001) for a, b in pairwise(chain)])
    lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    way = np.concatenate([np.linspace(0, n, 2001) + lengths[:i].sum() for i, n in enumerate(lengths)])
    gaps = np.linalg.norm(points[:, None] - fine[None], axis=-1)
    position, offset, distance = along_chain(chain, points)
    step = lengths.max() / 2000
    np.testing.assert_allclose(distance, gaps.min(axis=1), atol=step)
    np.testing.assert_allclose(position, way[gaps.argmin(axis=1)], atol=2 * step)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), distance)


def test_a_rigid_motion_changes_no_position():
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    points = np.random.default_rng(2).normal(size=(10, 3))
    before, after = along_chain(CHAIN, points), along_chain(CHAIN @ turn.T + 5, points @ turn.T + 5)
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)
    np.testing.assert_allclose(after[1], before[1] @ turn.T, atol=1e-12)


def test_joints_that_coincide_are_a_point():
    position, offset, distance = along_chain(np.ones((3, 3)), np.array([[1, 1, 3.0]]))
    assert (position[0], distance[0]) == (0, 2)
    assert offset[0].tolist() == [0, 0, 2]


def test_points_on_an_arm_are_its_own_and_those_of_trunk_and_legs_are_not():
    joints = standing_joints()
    arms = [joints[[16, 18, 20]], joints[[17, 19, 21]]]
    points = np.array([
        [0.35, 0.5, 0.03], [-0.7, 0.5, 0], [0.5, 0.47, 0],  # upper arm, wrist, elbow
        [0.05, 0.4, 0.1], [0.1, -0.5, 0.05], [0, 0.7, 0], [0.2, 0.5, 0],  # chest, shin, face, shoulder joint
    ])  # fmt: skip
    assert on_arms(points, joints, arms).tolist() == [True] * 3 + [False] * 4
    mirrored = points * [-1, 1, 1]
    assert np.array_equal(on_arms(mirrored, joints, arms), on_arms(points, joints, arms))
