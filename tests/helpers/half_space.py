"""The simplest obstacle: all below a height, with the distances that it was asked for counted."""

from __future__ import annotations

import torch

from fusion.obstacles.sdf import SdfQuery, differentiable_distance


class HalfSpace:
    """All points with y below `height` metres are inside; distances are exact and linear."""

    surfaces = ()  # it has no mesh
    lipschitz = True

    def __init__(self, height: float = 0.0) -> None:
        self.height = height
        self.queries: list[torch.Tensor] = []  # the points of each

    def update(self, heights: torch.Tensor) -> None:
        """Move to the first of some heights."""
        self.height = float(heights.reshape(-1)[0])

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """Distance, direction and closest point of points (..., 3); it is the same in all frames."""
        self.queries.append(points.detach().clone())
        up = torch.tensor([0.0, 1, 0]).to(points).expand_as(points)
        distance = points[..., 1] - self.height
        return SdfQuery(distance, up, points - distance[..., None] * up)

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """(...,) metres, differentiable."""
        return differentiable_distance(points, self)
