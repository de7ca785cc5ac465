"""The last clean-up: no vertex stays in the body, or below the garment beneath."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from fusion.obstacles.sdf import Obstacle
from fusion.topology import Topology
from render.mesh.normals import safe_normalize

# Fraction of a lifted vertex's step that its neighbours make, so that a single lifted vertex makes no spike.
_FOLLOW = 0.5
# Metres more than asked for, so that rounding leaves no vertex a hair below.
_MORE = 2e-6
# Metres of depth up to which the first round lifts; the reach doubles with every round, and the last two have no limit.
_REACH = 0.02
# Edges of deep vertices are pulled to at most so many times their rest length, in so many sweeps a round.
_STRETCH, _SWEEPS = 1.5, 10
# Between two walls: metres that may be missing, and the longest step along their middle in multiples of that.
_SQUEEZED, _LONGEST_STEP = 0.005, 10.0
# Of the search at the end: directions tried at every distance, and in metres the first distance, the ratio of each
# distance to the one before, and the last one.
_DIRECTIONS, _NEAREST, _RATIO, _UTMOST = 64, 1e-3, 1.25, 4.0


@dataclass(frozen=True, eq=False)
class Clearance:
    """What `lift_clear` did.

    Args:
        vertices: (T, N, 3), metres.
        rounds: in which something was lifted.
        queried: points that the obstacle was asked about, in multiples of T N.
        relocated: (T, N) bool, vertices that no round got out and a search in all directions did.
        remaining: (T, N) bool, vertices still nearer than the clearance: pinned, or shut in on all sides.
        distance: (T, N) metres, signed distances at the end.
    """

    vertices: torch.Tensor
    rounds: int
    queried: float
    relocated: torch.Tensor
    remaining: torch.Tensor
    distance: torch.Tensor


def clear_body(
    vertices: torch.Tensor,
    sdf: Obstacle,
    topology: Topology,
    *,
    clearance_m: float,
    rounds: int,
    fixed: torch.Tensor | None = None,
) -> torch.Tensor:
    """The vertices (T, N, 3), metres, of `lift_clear`, which explains the arguments."""
    return lift_clear(vertices, sdf, topology, clearance_m=clearance_m, rounds=rounds, fixed=fixed).vertices


def lift_clear(
    vertices: torch.Tensor,
    sdf: Obstacle,
    topology: Topology,
    *,
    clearance_m: float,
    rounds: int,
    fixed: torch.Tensor | None = None,
) -> Clearance:
    """Lift vertices that are nearer to the body than `clearance_m`, or inside it.

    Each round lifts along the distance's gradient, or where that differs from the round before (the fold between arm
    and trunk), along the middle of both. Neighbours that have clearance themselves make half of its step,
    on average over their neighbours; in the last two rounds nothing follows, so that it cannot push anything back
    in. Vertices deeper than a reach, 2 cm at first and twice as much with every round, wait: the cloth around them,
    once it is out, pulls them along by their edges, so that they come out on its side. What is still inside after
    all rounds is put at the nearest clear place of a search in all directions.

    So afterwards no vertex but the pinned ones is nearer than `clearance_m`. Two things are undefined: on which side
    a vertex comes out that is nearer to another side of the body and has no edge to cloth outside; and what happens
    between vertices, where a large face may still cut through the body.

    The garment may touch or cross itself afterwards: its collisions with itself are outside what the fusion solves.

    Args:
        vertices: (T, N, 3) metres, not changed.
        sdf: one posed obstacle a frame.
        topology: of the garment.
        clearance_m: metres, the distance that lifted vertices get.
        rounds: at most; fewer where all vertices are clear; 0 leaves everything as it is.
        fixed: (N,) bool, vertices that must not move; None holds none.
    """
    loose = torch.ones(vertices.shape[1], dtype=torch.bool, device=vertices.device)
    if fixed is not None:
        loose = ~fixed.to(vertices.device)
    cache = SdfCache(vertices, sdf)
    number = 0
    for number in range(rounds + 1):
        missing = (clearance_m - cache.distance) * loose
        if number == rounds or not bool((missing > 0).any()):
            break
        last = number >= rounds - 2
        reach = float("inf") if last else _REACH * 2**number
        cache.move(_round(cache, topology, missing, reach=reach, follow=not last, loose=loose))
    relocated = torch.zeros_like(cache.distance, dtype=torch.bool)
    if rounds:
        relocated = move_to_clear_places(cache, (cache.distance < clearance_m) & loose, clearance_m)
    remaining = cache.distance < clearance_m
    asked = cache.asked / max(remaining.numel(), 1)
    return Clearance(cache.vertices, number, asked, relocated, remaining, cache.distance)


def _round(
    cache: SdfCache,
    topology: Topology,
    missing: torch.Tensor,
    *,
    reach: float,
    follow: bool,
    loose: torch.Tensor,
) -> torch.Tensor:
    """(T, N, 3) the vertices after one round of lifting."""
    low = missing > 0
    deep = low & (cache.distance < -reach)
    lifted = (low & ~deep)[..., None]
    squeezed = (missing < _SQUEEZED)[..., None]
    upward = safe_normalize(cache.direction + torch.where(squeezed, cache.lifted_along, 0.0))
    slope = (upward * cache.direction).sum(-1, keepdim=True).clamp(min=1 / _LONGEST_STEP)
    lift = torch.where(lifted, (missing + _MORE)[..., None] * upward / slope, 0.0)
    cache.lifted_along = torch.where(lifted, cache.direction, 0.0)
    if follow:
        degree = topology.adjacency(lift.new_ones(topology.n_vertices, 1)).clamp(min=1)
        along = _FOLLOW * topology.adjacency(lift) / degree
        lift = torch.where((~low & loose)[..., None], along, lift)
    vertices = cache.vertices + lift
    return _pulled(vertices, deep, topology) if bool(deep.any()) else vertices


def _pulled(vertices: torch.Tensor, deep: torch.Tensor, topology: Topology) -> torch.Tensor:
    """Deep vertices moved so that their edges are no longer than `_STRETCH` times their rest lengths, about."""
    edges = torch.from_numpy(topology.edges).to(vertices.device)
    touched = (deep[:, edges[:, 0]] | deep[:, edges[:, 1]]).any(0)
    first, second = edges[touched].T
    longest = _STRETCH * topology.rest_lengths.to(vertices)[touched]
    for _ in range(_SWEEPS):
        span = vertices[:, second] - vertices[:, first]
        length = torch.linalg.vector_norm(span, dim=-1)
        pull = (1 - longest / length.clamp(min=1e-12)).clamp(min=0)[..., None] * span
        counted = torch.cat([pull, (pull != 0).any(-1, keepdim=True).to(pull)], -1)
        back = torch.cat([-pull, counted[..., 3:]], -1)
        total = vertices.new_zeros(*vertices.shape[:2], 4)
        total = total.index_add(1, first, counted).index_add(1, second, back)
        step = total[..., :3] / total[..., 3:].clamp(min=1)
        vertices = torch.where(deep[..., None], vertices + step, vertices)
    return vertices


class SdfCache:
    """Vertices with their distance and direction; only those that moved are asked about again.

    Args:
        vertices: (T, N, 3), metres.
        sdf: one posed obstacle a frame.
    """

    def __init__(self, vertices: torch.Tensor, sdf: Obstacle) -> None:
        self.sdf, self.vertices = sdf, vertices
        query = sdf.query(vertices)
        self.distance, self.direction = query.distance.to(vertices), query.direction.to(vertices)
        #: (T, N, 3) along which the last round lifted each vertex; 0 where it did not.
        self.lifted_along = torch.zeros_like(vertices)
        self.asked = self.distance.numel()

    def move(self, vertices: torch.Tensor) -> None:
        """Take other vertices (T, N, 3)."""
        moved = (vertices != self.vertices).any(-1)
        places = _padded_places(moved)
        spots = places[..., None].expand(-1, -1, 3)
        query = self.sdf.query(vertices.gather(1, spots))
        self.vertices = vertices
        self.distance = self.distance.scatter(1, places, query.distance.to(vertices))
        self.direction = self.direction.scatter(1, spots, query.direction.to(vertices))
        self.asked += places.numel()


def _padded_places(chosen: torch.Tensor) -> torch.Tensor:
    """(T, N) bool -> (T, K) int64: where each row is true, K the most in a row; shorter rows end with any others."""
    most = int(chosen.sum(-1).max()) if chosen.numel() else 0
    return torch.argsort(chosen, dim=1, descending=True, stable=True)[:, :most]


def move_to_clear_places(cache: SdfCache, inside: torch.Tensor, clearance_m: float) -> torch.Tensor:
    """Move the vertices `inside` (T, N) each to its nearest clear place among a set of directions and distances.

    Args:
        cache: the vertices (T, N, 3) that are moved in it.
        inside: (T, N) bool, which of them.
        clearance_m: metres, the distance at which a place is clear.

    Returns:
        (T, N) bool, those that have one.
    """
    relocated = torch.zeros_like(inside)
    directions = _sphere(_DIRECTIONS).to(cache.vertices)
    distance = _NEAREST
    while bool(inside.any()) and distance < _UTMOST:
        places = _padded_places(inside)
        spots = places[..., None].expand(-1, -1, 3)
        tried = cache.vertices.gather(1, spots)[:, :, None] + distance * directions
        clear = cache.sdf.query(tried.flatten(1, 2)).distance.reshape(tried.shape[:-1]) >= clearance_m
        cache.asked += clear.numel()
        out = clear.any(-1) & inside.gather(1, places)
        best = clear.to(torch.uint8).argmax(-1)[..., None, None].expand(-1, -1, 1, 3)
        target = torch.where(out[..., None], tried.gather(2, best)[:, :, 0], cache.vertices.gather(1, spots))
        relocated = relocated.scatter(1, places, out | relocated.gather(1, places))
        cache.move(cache.vertices.scatter(1, spots, target))
        inside = inside & ~relocated
        distance *= _RATIO
    return relocated


def _sphere(count: int) -> torch.Tensor:
    """(count, 3) unit vectors spread evenly."""
    k = torch.arange(count, dtype=torch.float64)
    up, angle = 1 - (2 * k + 1) / count, k * torch.pi * (3 - 5**0.5)
    around = (1 - up.square()).sqrt()
    return torch.stack([around * angle.cos(), up, around * angle.sin()], dim=1)
