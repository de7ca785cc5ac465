"""The last resort of the clean-up: a search for the nearest clear place."""

from __future__ import annotations

import torch

from fusion.obstacles.sdf import Obstacle

# Directions tried at every distance, the first distance in metres, the next one's ratio to it, the last one.
_DIRECTIONS, _NEAREST, _RATIO, _UTMOST = 64, 1e-3, 1.25, 4.0


class SdfCache:
    """Vertices with their distance and direction; only those that moved are asked about again.

    Args:
        vertices: (T, N, 3), metres.
        sdf: one posed obstacle a frame.
    """

    def __init__(self, vertices: torch.Tensor, sdf: Obstacle) -> None:
        self.sdf, self.vertices = sdf, vertices
        found = sdf.query(vertices)
        self.distance, self.direction = found.distance.to(vertices), found.direction.to(vertices)
        #: (T, N, 3) along which the last round lifted each vertex; 0 where it did not.
        self.lifted_along = torch.zeros_like(vertices)
        self.asked = self.distance.numel()

    def move(self, vertices: torch.Tensor) -> None:
        """Take other vertices (T, N, 3)."""
        moved = (vertices != self.vertices).any(-1)
        places = padded_places(moved)
        spots = places[..., None].expand(-1, -1, 3)
        found = self.sdf.query(vertices.gather(1, spots))
        self.vertices = vertices
        self.distance = self.distance.scatter(1, places, found.distance.to(vertices))
        self.direction = self.direction.scatter(1, spots, found.direction.to(vertices))
        self.asked += places.numel()


def padded_places(chosen: torch.Tensor) -> torch.Tensor:
    """(T, N) bool -> (T, K) int64: where each row is true, K the most in a row; shorter rows end with any others."""
    most = int(chosen.sum(-1).max()) if chosen.numel() else 0
    return torch.argsort(chosen, dim=1, descending=True, stable=True)[:, :most]


def escape(cache: SdfCache, inside: torch.Tensor, clearance_m: float) -> torch.Tensor:
    """Move the vertices `inside` (T, N) to the nearest clear place among a set of directions and distances.

    Returns:
        (T, N) bool, those that found one.
    """
    escaped = torch.zeros_like(inside)
    way = _sphere(_DIRECTIONS).to(cache.vertices)
    distance = _NEAREST
    while bool(inside.any()) and distance < _UTMOST:
        places = padded_places(inside)
        spots = places[..., None].expand(-1, -1, 3)
        tried = cache.vertices.gather(1, spots)[:, :, None] + distance * way
        clear = cache.sdf.query(tried.flatten(1, 2)).distance.reshape(tried.shape[:-1]) >= clearance_m
        cache.asked += clear.numel()
        out = clear.any(-1) & inside.gather(1, places)
        best = clear.to(torch.uint8).argmax(-1)[..., None, None].expand(-1, -1, 1, 3)
        target = torch.where(out[..., None], tried.gather(2, best)[:, :, 0], cache.vertices.gather(1, spots))
        escaped = escaped.scatter(1, places, out | escaped.gather(1, places))
        cache.move(cache.vertices.scatter(1, spots, target))
        inside = inside & ~escaped
        distance *= _RATIO
    return escaped


def _sphere(count: int) -> torch.Tensor:
    """(count, 3) unit vectors spread evenly."""
    k = torch.arange(count, dtype=torch.float64)
    up, angle = 1 - (2 * k + 1) / count, k * torch.pi * (3 - 5**0.5)
    around = (1 - up.square()).sqrt()
    return torch.stack([around * angle.cos(), up, around * angle.sin()], dim=1)
