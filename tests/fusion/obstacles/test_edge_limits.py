"""Edges that are no longer than they may be, by hand."""

import numpy as np
import torch

from fusion import Topology
from fusion.obstacles.edge_limits import _OVER, _SWEEPS, EdgeLimits, _swept
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


def plain_sweeps(points, ends, longest, walls, loose):
    """`_swept` edge by edge: half of what an edge is too long by to both of its ends, and of each end's the mean."""
    points = points.copy()
    for _ in range(_SWEEPS):
        pulls, counts = np.zeros_like(points), np.zeros(len(points))
        for (first, second), most in zip(ends, longest, strict=True):
            span = points[second] - points[first]
            length = np.sqrt(span @ span)
            if length > most:
                for end, sign in ((first, 1), (second, -1)):
                    pulls[end] += sign * 0.5 * (1 - most / length) * span
                    counts[end] += 1
        for point in range(len(points)):
            if counts[point] and loose[point]:
                step = _OVER * pulls[point] / counts[point]
                points[point] += step - min(step @ walls[point], 0) * walls[point]
    return points


def test_sweeps_are_those_of_a_plain_loop():
    random = np.random.default_rng(4)
    points, ends = random.normal(size=(12, 3)), random.integers(0, 12, size=(40, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    longest = random.uniform(0.2, 2.0, len(ends))
    walls = random.normal(size=(12, 3))
    walls /= np.linalg.norm(walls, axis=1, keepdims=True)
    walls[::3] = 0
    loose = random.random(12) < 0.8
    assert 0 < loose.sum() < 12
    given = (torch.from_numpy(values) for values in (points, ends, longest, walls, loose))
    found = _swept(*given).numpy()
    np.testing.assert_allclose(found, plain_sweeps(points, ends, longest, walls, loose), atol=1e-5)
    assert np.abs(found - points).max() > 0.1
    assert np.array_equal(found[~loose], points[~loose])
