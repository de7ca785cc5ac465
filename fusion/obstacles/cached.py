"""The body and what is worn beneath, as one obstacle that is asked about the same vertices again and again."""

from __future__ import annotations

import torch

from fusion.config import FusionConfig
from fusion.inputs import FusionInputs
from fusion.obstacles.bvh import MeshBvh
from fusion.obstacles.layers import MovingObstacle, Obstacles, OuterSurface
from fusion.obstacles.sdf import BodySdf, Obstacle, SdfQuery
from fusion.obstacles.surface_contact import SurfaceContact
from fusion.obstacles.tracking import DistanceTracker
from fusion.topology import Topology


class CachedObstacle:
    """An obstacle that remembers its answers: solver, report and clean-up ask about the same vertices.

    Args:
        obstacle: what is asked.
        surface: finds where the garment between its vertices is in it.

    Attributes:
        tracker: follows the garment's vertices from one query to the next.
    """

    def __init__(self, obstacle: Obstacles, surface: SurfaceContact | None = None) -> None:
        self._obstacle, self.surface = obstacle, surface
        self.tracker = DistanceTracker(obstacle)
        self._last: tuple[torch.Tensor, SdfQuery] | None = None

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """As `Obstacles.surfaces`."""
        return self._obstacle.surfaces

    @property
    def lipschitz(self) -> bool:
        """As `Obstacles.lipschitz`."""
        return self._obstacle.lipschitz

    def update(self, *vertices: torch.Tensor) -> None:
        """As `Obstacles.update`."""
        self._last = None
        self.tracker.forget()
        self._obstacle.update(*vertices)

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """As `Obstacles.query`; answers without `frames` are remembered."""
        if frames is not None:
            return self._obstacle.query(points, frames, outside=outside)
        if (
            self._last is None
            or self._last[0].shape != points.shape
            or not torch.equal(self._last[0], points)
        ):
            self._last = points.detach().clone(), self._obstacle.query(points, outside=outside)
            self.tracker.remember(*self._last)
        return self._last[1]

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """As `Obstacles.distance`."""
        return self._obstacle.distance(points)


def tracker_of(obstacle: Obstacle) -> DistanceTracker:
    """The obstacle's own, if it has one, or a new one."""
    return obstacle.tracker if isinstance(obstacle, CachedObstacle) else DistanceTracker(obstacle)


def make_obstacle(
    inputs: FusionInputs, config: FusionConfig, device: torch.device, topology: Topology
) -> CachedObstacle | None:
    """Body and inner garment as one, None without either."""
    parts: list[MovingObstacle] = []
    if inputs.body is not None:
        count = inputs.body.vertices.shape[1]
        parts.append(BodySdf(inputs.body.faces, count, device=device, band_m=config.sdf_band_m))
    if inputs.inner is not None:
        parts.append(
            OuterSurface(
                inputs.inner.faces,
                inputs.inner.vertices.shape[1],
                device=device,
                offset_m=config.inner_margin_m,
                band_m=config.sdf_band_m,
            )
        )
    if not parts:
        return None
    obstacles = Obstacles(parts)
    return CachedObstacle(obstacles, SurfaceContact(obstacles, topology, device))


def pose(obstacle: CachedObstacle, inputs: FusionInputs) -> None:
    """Let the obstacle stand where it does in the frames of the inputs."""
    obstacle.update(*(surface.vertices for surface in (inputs.body, inputs.inner) if surface is not None))
