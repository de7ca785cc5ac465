"""One round of putting vertices outside of an obstacle, and what keeps cloth in shape meanwhile."""

from __future__ import annotations

import torch

from fusion.obstacles.cached import tracker_of
from fusion.obstacles.sdf import Obstacle
from fusion.topology import Topology
from render.mesh.normals import safe_normalize

# Fraction of a lifted vertex's step that its neighbours make, so that a single lifted vertex makes no spike.
_FOLLOW = 0.5
# Metres more than asked for, so that rounding leaves no vertex a hair below.
_MORE = 2e-6
# Edges of deep vertices are pulled to at most so many times their rest length, in so many sweeps a round.
_STRETCH, _SWEEPS = 1.5, 10
# Between two walls: metres that may be missing, and the longest step along their middle in multiples of that.
_SQUEEZED, _LONGEST_STEP = 0.005, 10.0
# Sweeps over tangled vertices.
_SMOOTHINGS = 20


class SdfCache:
    """Vertices with their distance and direction, as far as they can be near.

    Args:
        vertices: (T, N, 3), metres.
        sdf: one posed obstacle a frame.
        within_m: metres up to which distances are exact; farther ones are at least as large as said.
    """

    def __init__(self, vertices: torch.Tensor, sdf: Obstacle, within_m: float) -> None:
        self._tracker, self._within = tracker_of(sdf), within_m
        self._asked_before = self._tracker.asked
        self.sdf = self._tracker.obstacle
        #: (T, N, 3) along which the last round lifted each vertex; 0 where it did not.
        self.lifted_along = torch.zeros_like(vertices)
        self.move(vertices)

    @property
    def asked(self) -> int:
        """How many points the obstacle has been asked about."""
        return self._tracker.asked - self._asked_before

    def move(self, vertices: torch.Tensor) -> None:
        """Take other vertices (T, N, 3)."""
        found = self._tracker.near(vertices, self._within)
        self.vertices, self.distance, self.direction = vertices, found.distance, found.direction

    def ask(self, points: torch.Tensor) -> torch.Tensor:
        """(T, K) the distances of other points (T, K, 3), metres."""
        self._tracker.asked += points.shape[:-1].numel()
        return self.sdf.query(points).distance


def lifted(
    cache: SdfCache,
    topology: Topology,
    missing: torch.Tensor,
    *,
    reach: float,
    follow: bool,
    loose: torch.Tensor,
) -> torch.Tensor:
    """(T, N, 3) the vertices after one round of lifting: see `fusion.obstacles.clearance.lift_clear`.

    Args:
        cache: the vertices.
        topology: of the garment.
        missing: (T, N) metres that vertices lack, above 0 where they do.
        reach: metres of depth up to which they are lifted; deeper ones are pulled by their edges.
        follow: whether neighbours make a part of the step.
        loose: (N,) bool, vertices that may move.
    """
    low = missing > 0
    deep = low & (cache.distance < -reach)
    ready = (low & ~deep)[..., None]
    squeezed = (missing < _SQUEEZED)[..., None]
    upward = safe_normalize(cache.direction + torch.where(squeezed, cache.lifted_along, 0.0))
    slope = (upward * cache.direction).sum(-1, keepdim=True).clamp(min=1 / _LONGEST_STEP)
    lift = torch.where(ready, (missing + _MORE)[..., None] * upward / slope, 0.0)
    # A frame in which nothing is low waits for others: by itself it would not have got here.
    waiting = ~low.any(-1)[:, None, None]
    cache.lifted_along = torch.where(waiting, cache.lifted_along, torch.where(ready, cache.direction, 0.0))
    if follow:
        lift = followed(lift, topology, ~low & loose)
    vertices = cache.vertices + lift
    return pulled(vertices, deep, topology) if bool(deep.any()) else vertices


def followed(lift: torch.Tensor, topology: Topology, following: torch.Tensor) -> torch.Tensor:
    """Lifts (T, N, 3) where vertices `following` (T, N) make half of their neighbours' mean."""
    degree = topology.adjacency(lift.new_ones(topology.n_vertices, 1)).clamp(min=1)
    along = _FOLLOW * topology.adjacency(lift) / degree
    return torch.where(following[..., None], along, lift)


def smoothed(vertices: torch.Tensor, tangled: torch.Tensor, topology: Topology) -> torch.Tensor:
    """Vertices (T, N, 3) of which those `tangled` (T, N) lie where their neighbours draw them, about."""
    edges = torch.from_numpy(topology.edges).to(vertices.device)
    touched = (tangled[:, edges[:, 0]] | tangled[:, edges[:, 1]]).any(0)
    first, second = edges[touched].T
    degree = torch.bincount(edges[touched].flatten(), minlength=topology.n_vertices).clamp(min=1)
    for _ in range(_SMOOTHINGS):
        total = torch.zeros_like(vertices)
        total.index_add_(1, first, vertices[:, second]).index_add_(1, second, vertices[:, first])
        vertices = torch.where(tangled[..., None], total / degree[:, None], vertices)
    return vertices


def pulled(vertices: torch.Tensor, deep: torch.Tensor, topology: Topology) -> torch.Tensor:
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


def padded_places(chosen: torch.Tensor) -> torch.Tensor:
    """(T, N) bool -> (T, K) int64: where each row is true, K the most in a row; shorter rows have others, too."""
    missing = chosen.sum(-1, keepdim=True)
    most = int(missing.max()) if chosen.numel() else 0
    others = (~chosen).cumsum(-1) <= most - missing
    return (chosen | others).nonzero()[:, 1].view(len(chosen), most)
