"""Adam's steps by hand, and the distance that is linear between two queries."""

import numpy as np
import pytest
import torch

from fusion import FusionConfig, Topology
from fusion.obstacles.sdf import SdfQuery
from fusion.solvers.adam import AdamSolver, TangentDistance, minimise
from fusion.stages import StageProblem
from render import Mesh
from tests.helpers.half_space import HalfSpace

TRIANGLE = Topology(Mesh(np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])))
REST = torch.from_numpy(TRIANGLE.rest_vertices)[None]


def bowl(vertices, step):
    """One value a frame, least at 0; each axis curved otherwise."""
    return {"bowl": (vertices.square() * torch.tensor([1.0, 10, 100])).sum((-2, -1))}


def test_the_first_step_is_the_learning_rate_along_each_axis_however_steep():
    start = torch.tensor([[[1.0, -1.0, 0.5]], [[-2.0, 3.0, 0.0]]])
    found = minimise(start, bowl, {"bowl": 1.0}, steps=1, learning_rate=0.01)
    want = start - 0.01 * start.sign()
    torch.testing.assert_close(found.vertices, want, rtol=0, atol=1e-6)
    assert found.iterations.tolist() == [1, 1]


def test_the_second_step_by_hand():
    """Moments of 0.1 g and 0.001 g², corrected for their start at 0: f = x² from 1 with a rate of 0.1."""
    start = torch.ones(1, 1, 1, dtype=torch.float64)
    found = minimise(
        start,
        lambda x, step: {"square": x.square().sum((-2, -1))},
        {"square": 1.0},
        steps=2,
        learning_rate=0.1,
    )
    x = 1 - 0.1 * 2 / (2 + 1e-8)
    first, second = 0.9 * 0.1 * 2 + 0.1 * 2 * x, 0.999 * 0.001 * 4 + 0.001 * (2 * x) ** 2
    x -= 0.1 * (first / (1 - 0.9**2)) / ((second / (1 - 0.999**2)) ** 0.5 + 1e-8)
    assert found.vertices.item() == pytest.approx(x, rel=1e-12)
    assert found.history["square"][:, 0].tolist() == pytest.approx([1, 0.81, x**2], rel=1e-7)


def test_pinned_vertices_do_not_move_by_a_bit_and_the_others_as_without_them():
    start = torch.randn(2, 4, 3, generator=torch.Generator().manual_seed(0))
    pinned = torch.tensor([True, False, False, True])
    free, held = (
        minimise(start, bowl, {"bowl": 1.0}, steps=5, learning_rate=0.1, fixed=fixed).vertices
        for fixed in (None, pinned)
    )
    assert torch.equal(held[:, pinned], start[:, pinned])
    assert torch.equal(held[:, ~pinned], free[:, ~pinned])
    assert not torch.equal(free[:, pinned], start[:, pinned])


def test_no_steps_leave_all_as_it_is_and_tell_where_that_is():
    start = torch.tensor([[[1.0, 0, 0]]])
    found = minimise(start, bowl, {"bowl": 1.0}, steps=0, learning_rate=0.1)
    assert torch.equal(found.vertices, start)
    assert found.history["bowl"].tolist() == [[1.0]]
    assert found.iterations.tolist() == [0]


def test_steps_are_told_their_number_and_the_end_is_a_step_with_a_query():
    numbers = []

    def terms(vertices, step):
        numbers.append(step)
        return bowl(vertices, step)

    minimise(torch.ones(1, 1, 3), terms, {"bowl": 1.0}, steps=3, learning_rate=0.1)
    assert numbers == [0, 1, 2, 0]


@pytest.mark.parametrize("every", [1, 2, 3])
def test_the_obstacle_is_asked_every_few_steps_and_at_the_end(every):
    obstacle = HalfSpace(-1.0)
    config = FusionConfig(normal_steps=5, sdf_every_steps=every)
    AdamSolver(TRIANGLE, config).normal_stage(StageProblem(start=REST, anchor=REST, obstacle=obstacle))
    assert len(obstacle.queries) == len(range(0, 5, every)) + 1


class Ball:
    """Distance to the unit sphere, curved where the tangent is not."""

    def query(self, points):
        length = points.norm(dim=-1, keepdim=True)
        return SdfQuery((length - 1)[..., 0], points / length, points / length)


def test_between_queries_the_distance_is_that_to_the_tangent_plane():
    """At (0, 2, 0) the ball is 1 m away; 0.5 m to the side it stays so, 0.5 m down it is half."""
    distance = TangentDistance(Ball(), 3)
    start = torch.tensor([[[0.0, 2, 0]]], dtype=torch.float64)
    assert distance(start, 0).tolist() == [[1.0]]
    for step, move, want in ((1, [0.5, 0, 0], 1.0), (2, [0, -0.5, 0], 0.5)):
        moved = (start + torch.tensor(move)).requires_grad_()
        found = distance(moved, step)
        assert found.tolist() == [[want]]
        (gradient,) = torch.autograd.grad(found.sum(), moved)
        assert gradient.tolist() == [[[0, 1, 0]]]
    assert distance(start + torch.tensor([1.5, 0, 0]), 3).item() == pytest.approx(2.5 - 1)  # exact again


def test_vertices_that_their_map_puts_into_the_ground_come_out_of_it():
    anchor = REST - torch.tensor([0, 2e-3, 0])  # 2 mm too low
    solver = AdamSolver(TRIANGLE, FusionConfig(normal_steps=12, learning_rate_m=3e-4))
    found = solver.normal_stage(StageProblem(start=anchor, anchor=anchor, obstacle=HalfSpace()))
    assert found.at(0)["collision_m"].item() == pytest.approx(2e-3 * 2 / 3)  # the third lies at 4 m
    assert found.at(-1)["collision_m"].item() < 1e-4


def test_the_margin_raises_the_ground():
    config = FusionConfig(normal_steps=0, collision_margin_m=0.01)
    found = AdamSolver(TRIANGLE, config).normal_stage(
        StageProblem(start=REST, anchor=REST, obstacle=HalfSpace())
    )
    assert found.at(0)["collision_m"].item() == pytest.approx(0.01 * 2 / 3)
