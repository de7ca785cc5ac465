"""The body and what is worn beneath, as one obstacle that is asked about the same vertices again and again."""

from __future__ import annotations

import torch

from fusion.config import FusionConfig
from fusion.inputs import FusionInputs
from fusion.obstacles.bvh import MeshBvh
from fusion.obstacles.layers import MovingObstacle, Obstacles, OuterSurface
from fusion.obstacles.sdf import BodySdf, SdfQuery
from fusion.obstacles.surface_contact import SurfaceContact
from fusion.topology import Topology


class CachedObstacle:
    """An obstacle that remembers its last answer: solver, report and clean-up ask about the same vertices.

    Args:
        obstacle: what is asked.
        surface: finds where the garment between its vertices is in it.
    """

    def __init__(self, obstacle: Obstacles, surface: SurfaceContact | None = None) -> None:
        self._obstacle, self.surface = obstacle, surface
        self._last: tuple[torch.Tensor, SdfQuery] | None = None

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """As `Obstacles.surfaces`."""
        return self._obstacle.surfaces

    def update(self, *vertices: torch.Tensor) -> None:
        """As `Obstacles.update`."""
        self._last = None
        self._obstacle.update(*vertices)

    def query(self, points: torch.Tensor) -> SdfQuery:
        """As `Obstacles.query`."""
        if (
            self._last is None
            or self._last[0].shape != points.shape
            or not torch.equal(self._last[0], points)
        ):
            self._last = points.detach().clone(), self._obstacle.query(points)
        return self._last[1]

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """As `Obstacles.distance`."""
        return self._obstacle.distance(points)


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
