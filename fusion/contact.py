"""Vertices against a surface, each by the tangent plane below it."""

from __future__ import annotations

import torch

from fusion.losses import collision_loss
from fusion.sdf import Obstacle

_TOUCHING = 1e-5  # metres: a vertex nearer to its plane than this touches it


class Contact:
    """Keeps vertices outside of an obstacle that is asked for only every few steps.

    In between, the surface below each vertex is its tangent plane; within the few millimetres that a vertex moves,
    that is as good.

    Args:
        obstacle: one posed obstacle a frame.
        margin_m: metres of clearance that vertices keep.
        every_steps: steps between two queries.
        loose: (N, 1) 1 for vertices that may move, 0 for those that are held; None for all.
    """

    def __init__(
        self, obstacle: Obstacle, margin_m: float, every_steps: int, loose: torch.Tensor | None = None
    ) -> None:
        self._obstacle, self._margin, self._every, self._loose = obstacle, margin_m, every_steps, loose
        self._normal = self._offset = torch.empty(0)
        #: (T,) metres, the collision term of equation 7 at the last look.
        self.depth = torch.empty(0)

    def due(self, step: int) -> bool:
        """Whether it is time for a query."""
        return step % self._every == 0

    def look(self, vertices: torch.Tensor) -> None:
        """Take new planes at vertices (T, N, 3)."""
        found = self._obstacle.query(vertices)
        self._normal = found.direction.to(vertices)
        distance = found.distance.to(vertices)
        self._offset = (self._normal * vertices).sum(-1) + (self._margin - distance)
        self.depth = collision_loss(distance, margin_m=self._margin)

    def pushed_out(self, vertices: torch.Tensor) -> torch.Tensor:
        """Vertices (T, N, 3), those below their planes brought up to them."""
        lift = (self._offset - (self._normal * vertices).sum(-1)).clamp(min=0)[..., None]
        if self._loose is not None:
            lift = lift * self._loose
        return torch.addcmul(vertices, lift, self._normal)

    def wall(self, vertices: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
        """(T, N, 3): the plane's normal where a vertex touches it and descent would push it in; 0 elsewhere."""
        gap = (self._normal * vertices).sum(-1) - self._offset
        pressed = (self._normal * gradient).sum(-1) > 0
        return self._normal * ((gap <= _TOUCHING) & pressed)[..., None]
