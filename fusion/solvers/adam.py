"""The paper's schedule: two stages of Adam over the vertices (sections 3.3 and 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch

from fusion.config import FusionConfig
from fusion.losses import (
    collision_loss,
    displacement_loss,
    edge_length_loss,
    normal_consistency_loss,
    normal_rendering_loss,
)
from fusion.obstacles.sdf import Obstacle
from fusion.stages import SolverResult, StageProblem, Terms, edge_weights, normal_weights, total
from fusion.topology import Topology, vertices_first
from render.mesh.sparse import SparseProduct


class AdamSolver:
    """The reference solver.

    Args:
        topology: of the template.
        config: weights and schedule.
        pixels: (P, N) interpolation at the covered pixels; needed where problems have targets.
        fixed: (N,) bool, vertices that stay where they start; None holds none.
    """

    def __init__(
        self,
        topology: Topology,
        config: FusionConfig,
        *,
        pixels: SparseProduct | None = None,
        fixed: torch.Tensor | None = None,
    ) -> None:
        self._topology, self._config, self._pixels, self._fixed = topology, config, pixels, fixed

    def edge_stage(self, problem: StageProblem) -> SolverResult:
        """First stage: L_e + λ_rv L_rv, the displacement over visible vertices only."""

        def terms(vertices: torch.Tensor, step: int) -> Terms:
            return self._both_stages(vertices, problem)

        return self._minimise(problem, terms, edge_weights(self._config), self._config.edge_steps)

    def normal_stage(self, problem: StageProblem) -> SolverResult:
        """Second stage, equation 8."""
        config, topology = self._config, self._topology
        distance = None
        if problem.obstacle is not None:
            distance = TangentDistance(problem.obstacle, config.sdf_every_steps)

        def terms(vertices: torch.Tensor, step: int) -> Terms:
            normals = topology.normals(vertices)
            values = {"normal_consistency": normal_consistency_loss(normals, topology)}
            values |= self._both_stages(vertices, problem)
            if problem.target is not None:
                assert self._pixels is not None
                values["normal_rendering"] = normal_rendering_loss(
                    self._pixels(normals), problem.target, problem.confidence
                )
            if distance is not None:
                values["collision_m"] = collision_loss(distance(vertices, step), margin_m=config.margin_m)
            return values

        return self._minimise(problem, terms, normal_weights(config), config.normal_steps)

    def _both_stages(self, vertices: torch.Tensor, problem: StageProblem) -> Terms:
        """The terms of both stages."""
        return {
            "edge_length_m2": edge_length_loss(vertices, self._topology),
            "displacement_m2": displacement_loss(vertices, problem.anchor, problem.vertex_weights),
        }

    def _minimise(
        self,
        problem: StageProblem,
        terms: Callable[[torch.Tensor, int], Terms],
        weights: Mapping[str, float],
        steps: int,
    ) -> SolverResult:
        rate = self._config.learning_rate_m
        return minimise(problem.start, terms, weights, steps=steps, learning_rate=rate, fixed=self._fixed)


def minimise(
    start: torch.Tensor,
    terms: Callable[[torch.Tensor, int], Terms],
    weights: Mapping[str, float],
    *,
    steps: int,
    learning_rate: float,
    fixed: torch.Tensor | None = None,
) -> SolverResult:
    """Adam on all frames at once; they stay independent, since it scales every coordinate by itself.

    Args:
        start: (T, N, 3), not changed.
        terms: vertices and step number -> named terms, one value a frame.
        weights: of the terms, by name.
        steps: how many.
        learning_rate: metres.
        fixed: (N,) bool, vertices that stay where they start; None holds none.
    """
    # A copy of its own: the stages also use `start` as what displacements are measured from.
    vertices = vertices_first(start.detach().clone()).requires_grad_()
    optimiser = torch.optim.Adam([vertices], lr=learning_rate)
    history: list[Terms] = []
    for step in range(steps):
        values = terms(vertices, step)
        history.append({name: value.detach() for name, value in values.items()})
        (vertices.grad,) = torch.autograd.grad(total(values, weights).sum(), [vertices])
        if fixed is not None:
            vertices.grad[:, fixed] = 0  # and so are Adam's moments: its step is exactly 0
        optimiser.step()
    with torch.no_grad():
        history.append(terms(vertices, 0))
    curves = {name: torch.stack([values[name] for values in history]) for name in history[0]}
    return SolverResult(vertices.detach(), curves, torch.full((len(start),), steps))


class TangentDistance:
    """Signed distance that is asked for every few steps and linear in the vertices in between.

    Adam moves a vertex by about a millimetre a step, over which the distance to a body is as good as linear.

    Args:
        obstacle: one posed obstacle a frame.
        every_steps: steps between two queries.
    """

    def __init__(self, obstacle: Obstacle, every_steps: int) -> None:
        self._obstacle, self._every = obstacle, every_steps
        self._offset = self._direction = torch.empty(0)

    def __call__(self, vertices: torch.Tensor, step: int) -> torch.Tensor:
        """(T, N, 3) metres -> (T, N) metres, negative inside, differentiable; exact at steps with a query."""
        if step % self._every == 0:
            query = self._obstacle.query(vertices)
            self._direction = query.direction.to(vertices)
            self._offset = query.distance.to(vertices) - (self._direction * vertices.detach()).sum(-1)
        return self._offset + (self._direction * vertices).sum(-1)
