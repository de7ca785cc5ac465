"""Distances of vertices that move a little at a time: what is asked, and what holds of the others."""

import numpy as np
import pytest
import torch

from fusion.obstacles.cached import CachedObstacle, tracker_of
from fusion.obstacles.layers import Obstacles, OuterSurface
from fusion.obstacles.sdf import BodySdf
from fusion.obstacles.tracking import DistanceTracker
from tests.helpers.example_meshes import two_triangles
from tests.helpers.fusion_examples import cylinder_body
from tests.helpers.half_space import HalfSpace


def heights(*values):
    """(1, N, 3) at these heights above the ground."""
    vertices = torch.zeros(1, len(values), 3)
    vertices[0, :, 1] = torch.tensor(values)
    return vertices


def test_only_vertices_that_can_have_come_near_are_asked_about_again():
    """Of 5, 2 and 1 m, asked up to half a metre: one stays, one may have come down by 1 m, one by 0.6 m."""
    space = HalfSpace()
    tracker = DistanceTracker(space)
    assert tracker.near(heights(5.0, 2.0, 1.0), 0.5).distance.tolist() == [[5, 2, 1]]
    moved = heights(5.0, 2.0, 1.0) + torch.tensor([[0.0, 0, 0], [1.0, 0, 0], [0.6, 0, 0]])
    found = tracker.near(moved, 0.5).distance[0]
    assert space.queries[1].tolist() == moved[:, 2].tolist()
    assert found[[0, 2]].tolist() == [5, 1]
    assert found[1].item() == pytest.approx(1.0, abs=1e-5)  # at least that; it is 2
    assert tracker.asked == 4
    # Back where it was: the answer is known, from the place where it was asked.
    assert tracker.near(heights(5.0, 2.0, 1.0), 0.5).distance[0, 1].item() == 2
    tracker.forget()
    tracker.near(moved, 0.5)
    assert space.queries[-1].shape == (1, 3, 3)


def test_nothing_is_asked_about_frames_that_are_not_wanted():
    """Both have come down by 1 m; what is known of the second is as if it had not been looked at."""
    space = HalfSpace()
    tracker = DistanceTracker(space)
    above, below = torch.cat([heights(1.5)] * 2), torch.cat([heights(0.5)] * 2)
    tracker.near(above, 1.0)
    found = tracker.near(below, 1.0, torch.tensor([True, False])).distance
    assert (tracker.asked, found[0].item()) == (3, 0.5)
    assert found[1].item() == pytest.approx(0.5, abs=1e-5)
    assert tracker.near(above, 1.0, torch.tensor([False, True])).distance[1].item() == 1.5
    assert tracker.asked == 3


def test_another_number_of_vertices_is_asked_about_whole():
    space = HalfSpace()
    tracker = DistanceTracker(space)
    tracker.near(heights(1.0, 2.0), 0.0)
    assert tracker.near(heights(3.0), 0.0).distance.tolist() == [[3]]


def test_a_walk_about_a_body_finds_what_full_queries_find():
    """Random steps of a centimetre: near ones to the bit, with their direction, others never too far."""
    body = cylinder_body()
    sdf = BodySdf(body.faces, len(body.vertices), band_m=0.05)
    sdf.update(np.stack([body.vertices] * 2))
    rng = torch.Generator().manual_seed(0)
    vertices = torch.rand(2, 300, 3, generator=rng) * 0.4 - 0.2
    tracker, within = DistanceTracker(sdf), 0.01
    for _ in range(6):
        found, full = tracker.near(vertices, within), sdf.query(vertices)
        near = full.distance <= within
        assert torch.equal(found.distance[near], full.distance[near])
        assert torch.equal(found.direction[near], full.direction[near])
        assert (found.distance <= full.distance).all()
        assert (found.distance[~near] > within).all()
        vertices = vertices + 0.01 * torch.randn(vertices.shape, generator=rng)
    assert tracker.asked < 0.8 * 6 * 600


def test_about_an_open_surface_whatever_moved_is_asked_about():
    """Round its rim one gets below it without coming near."""
    square = two_triangles()
    obstacle = Obstacles([OuterSurface(square.faces, 4)])
    obstacle.update(torch.from_numpy(square.vertices)[None])
    tracker = DistanceTracker(obstacle)
    tracker.near(torch.tensor([[[0.1, 0.1, 0.04], [0.1, 0.2, 0.04]]]), 0.0)
    tracker.near(torch.tensor([[[0.1, 0.1, 0.04], [0.1, 0.2, 0.041]]]), 0.0)
    assert tracker.asked == 3


def test_an_obstacle_that_remembers_shares_what_it_knows_and_forgets_when_it_moves():
    space = HalfSpace()
    cached = CachedObstacle(Obstacles([space]))
    assert tracker_of(cached) is cached.tracker
    assert tracker_of(space) is not tracker_of(space)
    cached.query(heights(1.0, 2.0))
    cached.tracker.near(heights(1.0, 2.0), 9.0)
    assert len(space.queries) == 1
    cached.update(torch.tensor([0.5]))
    assert cached.tracker.near(heights(1.0, 2.0), 0.0).distance.tolist() == [[0.5, 1.5]]
