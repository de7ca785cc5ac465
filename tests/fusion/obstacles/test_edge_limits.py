"""Edges that are no longer than they may be, by hand."""

import numpy as np
import torch

from fusion import Topology
from fusion.obstacles.edge_limits import EdgeLimits
from render import Mesh

TRIANGLE = Topology(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])))
REST = torch.from_numpy(TRIANGLE.rest_vertices)[None]
ALL, FRAME = torch.ones(3, dtype=torch.bool), torch.ones(1, dtype=torch.bool)


def longest(points, start=REST):
    """The largest length over the one at rest."""
    lengths = TRIANGLE.difference(points).norm(dim=-1) / TRIANGLE.rest_lengths
    return lengths.max().item()


def test_a_long_edge_is_shortened_to_a_twentieth_more_than_at_rest():
    points = REST.clone()
    points[0, 1, 0] = 1.4
    limits = EdgeLimits(REST, TRIANGLE, ALL)
    np.testing.assert_allclose(limits.excess(points), [1.4 / 1.05 - 1])
    found = limits.kept(points, torch.zeros_like(points), FRAME)
    assert longest(found) < 1.06
    assert found[0, 0, 0] > 0  # both ends move
    assert 1.0 < found[0, 1, 0] < 1.4


def test_what_was_as_long_at_the_start_stays():
    points = REST.clone()
    points[0, 1, 0] = 1.4
    limits = EdgeLimits(points, TRIANGLE, ALL)
    assert limits.excess(points).item() == 0
    moved = points + torch.tensor([0.0, 0, 0.3])
    torch.testing.assert_close(limits.kept(moved, torch.zeros_like(moved), FRAME), moved)


def test_pins_walls_and_other_frames_hold():
    """The first vertex is pinned; the second touches what is to its left, and stays where it is."""
    points = REST.repeat(2, 1, 1)
    points[:, 1, 0] = 1.4
    walls = torch.zeros_like(points)
    walls[:, 1, 0] = 1.0
    loose = torch.tensor([False, True, True])
    limits = EdgeLimits(REST.repeat(2, 1, 1), TRIANGLE, loose)
    found = limits.kept(points, walls, torch.tensor([True, False]))
    assert torch.equal(found[:, 0], points[:, 0])
    assert torch.equal(found[1], points[1])
    assert found[0, 1, 0] >= 1.4
    assert not torch.equal(found[0, 2], points[0, 2])
