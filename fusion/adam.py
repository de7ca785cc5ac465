"""The paper's schedule: two stages of Adam over the vertices (sections 3.3 and 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch

from fusion.config import FusionConfig
from fusion.losses import (
    collision_loss,
    displacement_loss,
    edge_length_loss,
    normal_consistency_loss,
    normal_rendering_loss,
)
from fusion.sdf import BodySdf
from fusion.topology import Topology, vertices_first
from render.operator import SparseProduct

Terms = dict[str, torch.Tensor]  # by name, one value a frame: (T,)
CENTIMETRES = 100.0  # in a metre; the unit of lengths that the weights are made for


@dataclass(frozen=True, eq=False)
class Minimum:
    """What `minimise` found.

    Args:
        vertices: (T, N, 3) metres.
        start, end: the terms (T,) before the first and after the last step, unweighted, in metres.
    """

    vertices: torch.Tensor
    start: Terms
    end: Terms


def edge_stage(
    initial: torch.Tensor, topology: Topology, seen: torch.Tensor, config: FusionConfig
) -> Minimum:
    """First stage: L_e + λ_rv L_rv, the displacement over visible vertices only.

    Args:
        initial: (T, N, 3) metres, from the position maps.
        topology: of the template.
        seen: (N,) floating point, 1 for visible vertices and 0 for others.
        config: weights and schedule.
    """

    def terms(vertices: torch.Tensor, step: int) -> Terms:
        return {
            "edge_length_m2": edge_length_loss(vertices, topology),
            "displacement_m2": displacement_loss(vertices, initial, seen),
        }

    weights = {
        "edge_length_m2": CENTIMETRES**2,
        "displacement_m2": config.weight_displacement * CENTIMETRES**2,
    }
    return minimise(initial, terms, weights, steps=config.edge_steps, learning_rate=config.learning_rate_m)


def normal_stage(
    initial: torch.Tensor,
    topology: Topology,
    config: FusionConfig,
    *,
    pixels: SparseProduct | None = None,
    target: torch.Tensor | None = None,
    sdf: BodySdf | None = None,
) -> Minimum:
    """Second stage, equation 8; the terms whose input is missing are left out.

    Args:
        initial: (T, N, 3) metres, result of the first stage.
        topology: of the template.
        config: weights and schedule.
        pixels: (P, N) interpolation at the covered pixels; goes with `target`.
        target: (T, P, 3) unit normals at these pixels.
        sdf: the T posed bodies.
    """
    distance = None if sdf is None else TangentDistance(sdf, config.sdf_every_steps)

    def terms(vertices: torch.Tensor, step: int) -> Terms:
        normals = topology.normals(vertices)
        found = {
            "normal_consistency": normal_consistency_loss(normals, topology),
            "edge_length_m2": edge_length_loss(vertices, topology),
            "displacement_m2": displacement_loss(vertices, initial),
        }
        if pixels is not None and target is not None:
            found["normal_rendering"] = normal_rendering_loss(pixels(normals), target)
        if distance is not None:
            found["collision_m"] = collision_loss(
                distance(vertices, step), margin_m=config.collision_margin_m
            )
        return found

    weights = {
        "normal_rendering": 1.0,
        "normal_consistency": config.weight_consistency,
        "edge_length_m2": config.weight_edge * CENTIMETRES**2,
        "displacement_m2": config.weight_displacement * CENTIMETRES**2,
        "collision_m": config.weight_collision * CENTIMETRES,
    }
    return minimise(initial, terms, weights, steps=config.normal_steps, learning_rate=config.learning_rate_m)


def minimise(
    start: torch.Tensor,
    terms: Callable[[torch.Tensor, int], Terms],
    weights: Mapping[str, float],
    *,
    steps: int,
    learning_rate: float,
) -> Minimum:
    """Adam on all frames at once; they stay independent, since it scales every coordinate by itself.

    Args:
        start: (T, N, 3), not changed.
        terms: vertices and step number -> named terms, one value a frame.
        weights: of the terms, by name.
        steps: how many.
        learning_rate: metres.
    """
    # A copy of its own: the stages also use `start` as what displacements are measured from.
    vertices = vertices_first(start.detach().clone()).requires_grad_()
    optimiser = torch.optim.Adam([vertices], lr=learning_rate)
    first: Terms = {}
    for step in range(steps):
        found = terms(vertices, step)
        if step == 0:
            first = {name: value.detach() for name, value in found.items()}
        total = torch.stack([weights[name] * value for name, value in found.items()]).sum()
        (vertices.grad,) = torch.autograd.grad(total, [vertices])
        optimiser.step()
    with torch.no_grad():
        last = terms(vertices, 0)
    return Minimum(vertices.detach(), first or last, last)


class TangentDistance:
    """Signed distance that is asked for every few steps and linear in the vertices in between.

    Adam moves a vertex by about a millimetre a step, over which the distance to a body is as good as linear.

    Args:
        sdf: one posed body a frame.
        every_steps: steps between two queries.
    """

    def __init__(self, sdf: BodySdf, every_steps: int) -> None:
        self._sdf, self._every = sdf, every_steps
        self._offset = self._direction = torch.empty(0)

    def __call__(self, vertices: torch.Tensor, step: int) -> torch.Tensor:
        """(T, N, 3) metres -> (T, N) metres, negative inside, differentiable; exact at steps with a query."""
        if step % self._every == 0:
            found = self._sdf.query(vertices)
            self._direction = found.direction.to(vertices)
            self._offset = found.distance.to(vertices) - (self._direction * vertices.detach()).sum(-1)
        return self._offset + (self._direction * vertices).sum(-1)
