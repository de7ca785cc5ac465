"""An obstacle that remembers its last answer."""

import torch

from fusion.obstacles.cached import CachedObstacle
from fusion.obstacles.layers import Obstacles
from tests.helpers.half_space import HalfSpace


def test_an_obstacle_is_asked_once_about_the_same_points():
    space = HalfSpace()
    cached = CachedObstacle(Obstacles([space]))
    points = torch.ones(1, 3, 3)
    first = cached.query(points)
    assert cached.query(points.clone()) is first
    points[0, 0, 1] = 5.0  # in place: the answer was to what they had been
    assert cached.query(points).distance[0].tolist() == [5, 1, 1]
    assert cached.query(points[:, :2]).distance.shape == (1, 2)
    assert len(space.queries) == 3


def test_an_obstacle_that_moved_is_asked_again():
    space = HalfSpace()
    cached = CachedObstacle(Obstacles([space]))
    points = torch.ones(1, 3, 3)
    assert cached.query(points).distance.unique().tolist() == [1]
    cached.update(torch.tensor([0.75]))
    assert cached.query(points).distance.unique().tolist() == [0.25]
    assert cached.distance(points).unique().tolist() == [0.25]
