"""Distances of vertices that move a little at a time: only those that can have come near are asked about again."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from fusion.obstacles.sdf import Obstacle, SdfQuery

_ROUNDING = 1e-6  # metres that a bound gives way, a few roundings of a coordinate


@dataclass(frozen=True, eq=False)
class NearDistances:
    """What is known of vertices (T, N, 3).

    Args:
        distance: (T, N) metres, signed; exact where it is at most what was asked for, elsewhere at most the distance.
        direction: (T, N, 3) unit vectors outwards, or 0: as last asked for.
    """

    distance: torch.Tensor
    direction: torch.Tensor


class DistanceTracker:
    """Follows the distances of one array of vertices.

    A vertex that was d away from the obstacle and has moved by m since is at least d - m away. Where that is more than
    the caller wants to know, the obstacle is not asked. That holds where distances change no faster than points move
    (`Obstacle.lipschitz`); elsewhere all vertices that have moved are asked about.

    Args:
        obstacle: one posed obstacle a frame.

    Attributes:
        asked: how many points the obstacle has been asked about.
    """

    def __init__(self, obstacle: Obstacle) -> None:
        self.obstacle, self.asked = obstacle, 0
        self._at: torch.Tensor | None = None  # (T, N, 3) where each vertex was when it was last asked about
        self._then: NearDistances | None = None

    def forget(self) -> None:
        """The obstacle has moved."""
        self._at = self._then = None

    def remember(self, vertices: torch.Tensor, query: SdfQuery) -> None:
        """Take an answer about all vertices (T, N, 3), which nobody may change any more."""
        self._at = vertices
        self._then = NearDistances(query.distance.to(vertices), query.direction.to(vertices))

    def near(
        self, vertices: torch.Tensor, within_m: float, frames: torch.Tensor | None = None
    ) -> NearDistances:
        """Of vertices (T, N, 3), exact where they are at most `within_m` metres away.

        Args:
            frames: (T,) bool, of which frames that is wanted; nothing is asked about others. None: all, as at first.
        """
        before, then = self._at, self._then
        if before is None or then is None or before.shape != vertices.shape:
            self.asked += vertices.shape[:-1].numel()
            self.remember(vertices.detach().clone(), self.obstacle.query(vertices))
            assert self._then is not None
            return self._then
        moved = torch.linalg.vector_norm(vertices - before, dim=-1)
        at_least = then.distance - moved - _ROUNDING
        ask, outside = moved > 0, None
        if self.obstacle.lipschitz:
            ask &= at_least <= within_m
        if frames is not None:
            ask &= frames[:, None]
        distance, direction = torch.where(moved > 0, at_least, then.distance), then.direction
        places = ask.flatten().nonzero()[:, 0]
        if len(places):
            points = vertices.reshape(-1, 3).index_select(0, places)
            if self.obstacle.lipschitz:
                outside = at_least.flatten().index_select(0, places) > 0
            query = self.obstacle.query(points, places // vertices.shape[1], outside=outside)
            self.asked += len(points)
            asked_distance = query.distance.to(points)
            direction = _with_rows(direction, places, query.direction.to(points))
            distance = _with_rows(distance, places, asked_distance)
            self._at = _with_rows(before, places, points)
            self._then = NearDistances(_with_rows(then.distance, places, asked_distance), direction)
        return NearDistances(distance, direction)


def _with_rows(values: torch.Tensor, places: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """A copy of values (T, N, ...) with rows (K, ...) at places (K,), counted on over the frames."""
    return values.flatten(0, 1).index_copy(0, places, rows).view(values.shape)
