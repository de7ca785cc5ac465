"""Cloth that passes through itself, taken apart: contours of intersection are made shorter until there are none.

What is on the wrong side of what is not known: position maps have no history. So nothing is decided about sides; where
an edge passes through a face, both are moved against each other along the direction in which the contour of the
intersection gets shorter (Volino and Magnenat-Thalmann, Resolving surface collisions through intersection contour
minimization, SIGGRAPH 2006).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.obstacles.crossings import Crossings, EdgeCrossings
from fusion.obstacles.sdf import Obstacle, SdfQuery
from fusion.topology import Topology
from render.mesh.mesh import edges_of
from render.mesh.normals import safe_normalize

# Regions are looked at anew after as many rounds as the second number says, the first one times at most.
_PASSES, _ROUNDS = 3, 30
# Edges from a crossing within which cloth moves.
_RINGS = 10
# Metres that edge and face move against each other in a round, where the direction is clear; and the length of the
# gradient, without a unit, at which it is half clear.
_STEP, _CLEAR = 0.008, 0.1
# The sine of the angle between edge and face below which it counts as that much.
_FLAT = 0.1
# Edges are kept between these multiples of their rest length, or what they had before where that is outside; the
# correction of every vertex is the mean of its edges' times the last number.
_SHORTEST, _LONGEST, _PULL = 0.9, 1.05, 1.5
# At the end: rounds of so many sweeps over all edges, with these multiples.
_SETTLING, _SWEEPS, _SETTLED = 8, 5, (0.98, 1.02)

Limits = tuple[torch.Tensor, torch.Tensor]  # shortest and longest lengths of edges, (T, E) metres


class Untangler:
    """Takes a garment out of itself; frames and regions without a crossing are not touched. Threads may share it.

    Args:
        topology: of the garment.
        fixed: (N,) bool, vertices that must not move; None holds none.
        device: where vertices are.
    """

    def __init__(
        self, topology: Topology, fixed: torch.Tensor | None, device: str | torch.device = "cpu"
    ) -> None:
        self._topology, self._device = topology, torch.device(device)
        self._loose = torch.ones(topology.n_vertices, dtype=torch.bool, device=self._device)
        if fixed is not None:
            self._loose = ~fixed.to(self._device)

    def untangled(
        self, vertices: torch.Tensor, obstacle: Obstacle | None = None, clearance_m: float = 0.0
    ) -> torch.Tensor:
        """Vertices (T, N, 3), metres, of which no frame has more crossings than before.

        Args:
            vertices: (T, N, 3) metres, not changed.
            obstacle: T posed ones, which moved vertices keep out of.
            clearance_m: metres, how far.
        """
        topology = self._topology
        search = EdgeCrossings(
            topology.edges,
            topology.faces,
            topology.n_vertices,
            itself=True,
            device=self._device,
            name="garment",
        )
        crossings = search.query(vertices)
        for _ in range(_PASSES):
            counts = crossings.counts()
            if not bool(counts.any()):
                break
            query = None if obstacle is None else obstacle.query(vertices)
            moved = vertices.clone()
            for frame in counts.nonzero().flatten().tolist():
                here = crossings.frame == frame
                patch = self._patch(crossings.edge[here], crossings.face[here])
                start = vertices[frame : frame + 1, patch.vertices]
                planes = _Planes.of(start, query, frame, patch, clearance_m)
                moved[frame, patch.vertices] = _taken_apart(start, patch, planes)[0]
            better = search.query(moved).counts() < counts
            if not bool(better.any()):
                break
            vertices = torch.where(better[:, None, None], moved, vertices)
            crossings = search.query(vertices)
        return vertices

    def _patch(self, edge: torch.Tensor, face: torch.Tensor) -> _Patch:
        """The cloth around edges and faces that cross, by their rows; its rim does not move."""
        topology = self._topology
        edges, faces = torch.from_numpy(topology.edges), torch.from_numpy(topology.faces)
        near = torch.zeros(topology.n_vertices, 1, device=self._device)
        near[edges[edge.cpu()].flatten()] = 1
        near[faces[face.cpu()].flatten()] = 1
        for _ in range(_RINGS):
            near = ((near + topology.adjacency(near)) > 0).to(near)
        inside = near[:, 0].cpu().numpy() > 0
        rim = inside & (topology.adjacency(1 - near)[:, 0].cpu().numpy() > 0)
        chosen = topology.faces[inside[topology.faces].all(1)]
        number = np.cumsum(inside) - 1
        loose = self._loose & torch.from_numpy(~rim).to(self._device)
        return _Patch.of(
            np.flatnonzero(inside), number[chosen], topology.rest_vertices[inside], loose, self._device
        )


@dataclass(frozen=True, eq=False)
class _Patch:
    """Some faces of a mesh with numbers of their own.

    Args:
        vertices: (R,) int64, numbers in the mesh. loose: (R,) bool, whether they may move.
        edges: (E, 2), faces: (F, 3), opposite: (E, 2) int64; the last holds each edge's third vertex in both faces at
            it, -1 where there is none.
        rest: (E,) metres, lengths at rest.
        search: of crossings with itself.
    """

    vertices: torch.Tensor
    loose: torch.Tensor
    edges: torch.Tensor
    faces: torch.Tensor
    opposite: torch.Tensor
    rest: torch.Tensor
    search: EdgeCrossings

    @classmethod
    def of(
        cls,
        vertices: np.ndarray,
        faces: np.ndarray,
        rest: np.ndarray,
        loose: torch.Tensor,
        device: torch.device,
    ) -> _Patch:
        """From `vertices` (R,) of the mesh, faces (F, 3) among them, rest places (R, 3), and loose ones (N,)."""
        edges = edges_of(faces)
        numbers = torch.from_numpy(vertices).to(device)
        lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        return cls(
            vertices=numbers,
            loose=loose[numbers],
            edges=torch.from_numpy(edges).to(device),
            faces=torch.from_numpy(faces).to(device),
            opposite=torch.from_numpy(_opposite(edges, faces)).to(device),
            rest=torch.from_numpy(lengths).to(device, torch.float32),
            search=EdgeCrossings(edges, faces, len(vertices), itself=True, device=device, name="garment"),
        )


def _opposite(edges: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(E, 2) the third vertices of the first two faces at each edge, -1 where there are fewer."""
    halves = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    third = faces[:, [2, 0, 1]].reshape(-1)
    order = np.lexsort((halves[:, 1], halves[:, 0]))
    starts = np.searchsorted(_keys(halves[order], edges), _keys(edges, edges))
    counts = np.diff(np.append(starts, len(order)))
    opposite = np.full((len(edges), 2), -1)
    for place in range(2):
        there = counts > place
        opposite[there, place] = third[order[starts[there] + place]]
    return opposite


def _keys(pairs: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(P,) one number a pair of vertices, in their order."""
    keys: np.ndarray = pairs[:, 0] * (int(edges.max()) + 1) + pairs[:, 1]
    return keys


@dataclass(frozen=True, eq=False)
class _Planes:
    """What a patch (1, R, 3) keeps out of, as planes: near where it starts, distances change evenly.

    Args:
        start: (1, R, 3) metres. missing: (1, R) metres to the clearance there, negative where there is more.
        direction: (1, R, 3) outwards.
    """

    start: torch.Tensor
    missing: torch.Tensor
    direction: torch.Tensor

    @classmethod
    def of(
        cls, start: torch.Tensor, query: SdfQuery | None, frame: int, patch: _Patch, clearance_m: float
    ) -> _Planes:
        """For one frame of a query about all vertices; None keeps out of nothing."""
        if query is None:
            return cls(start, start.new_full(start.shape[:2], -torch.inf), torch.zeros_like(start))
        distance, direction = query.distance[frame, patch.vertices], query.direction[frame, patch.vertices]
        missing = torch.where(patch.loose, clearance_m - distance.to(start), -torch.inf)
        return cls(start, missing[None], direction.to(start)[None])

    def lifted(self, vertices: torch.Tensor) -> torch.Tensor:
        """Vertices (1, R, 3), those below their plane put on it."""
        gained = ((vertices - self.start) * self.direction).sum(-1)
        return vertices + (self.missing - gained).clamp(min=0)[..., None] * self.direction


def _taken_apart(vertices: torch.Tensor, patch: _Patch, planes: _Planes) -> torch.Tensor:
    """The vertices (1, R, 3) of a patch after some rounds: those with the fewest crossings, the earliest of them."""
    lengths = _lengths(vertices, patch)
    limits = torch.minimum(lengths, _SHORTEST * patch.rest), torch.maximum(lengths, _LONGEST * patch.rest)
    best, fewest = vertices, patch.search.query(vertices)
    crossings = fewest
    for _ in range(_ROUNDS):
        vertices = vertices + _push(vertices, crossings, patch) * patch.loose[:, None]
        vertices = planes.lifted(_pulled(vertices, patch, limits))
        crossings = patch.search.query(vertices)
        if int(crossings.counts()) < int(fewest.counts()):
            best, fewest = vertices, crossings
        if not len(crossings.edge):
            break
    limits = (
        torch.minimum(lengths, _SETTLED[0] * patch.rest),
        torch.maximum(lengths, _SETTLED[1] * patch.rest),
    )
    return _settled(best, patch, planes, limits, int(fewest.counts()))


def _settled(
    vertices: torch.Tensor, patch: _Patch, planes: _Planes, limits: Limits, fewest: int
) -> torch.Tensor:
    """The vertices (1, R, 3) with their edges nearer to the limits, and no more crossings than the `fewest`."""
    best = vertices
    for _ in range(_SETTLING):
        for _ in range(_SWEEPS):
            vertices = _pulled(vertices, patch, limits)
        vertices = planes.lifted(vertices)
        crossings = patch.search.query(vertices)
        if int(crossings.counts()) <= fewest:
            best = vertices
        vertices = vertices + 0.5 * _push(vertices, crossings, patch) * patch.loose[:, None]
    return best


def _push(vertices: torch.Tensor, crossings: Crossings, patch: _Patch) -> torch.Tensor:
    """(T, R, 3) metres by which edges and the faces that they pass through move against each other.

    With R the sum of the unit vectors along which the contour leaves the edge, one into each face at it, E the edge's
    direction and N the face's normal, the contour gets shorter where the edge moves along R - 2 (E · R) / (E · N) N.
    """
    frame, ends, corners = crossings.frame, patch.edges[crossings.edge], patch.faces[crossings.face]
    a, b = vertices[frame, ends[:, 0]], vertices[frame, ends[:, 1]]
    p, q, r = (vertices[frame, corners[:, k]] for k in range(3))
    along = safe_normalize(b - a)
    normal = safe_normalize(torch.linalg.cross(q - p, r - p))
    leaving = torch.zeros_like(along)
    for third in patch.opposite[crossings.edge].unbind(1):
        to_third = vertices[frame, third.clamp(min=0)] - a
        contour = safe_normalize(torch.linalg.cross(normal, torch.linalg.cross(b - a, to_third)))
        inward = to_third - along * (along * to_third).sum(-1, keepdim=True)
        turned = torch.sign((contour * inward).sum(-1, keepdim=True))
        leaving = leaving + contour * turned * (third >= 0)[:, None]
    steepness = (along * normal).sum(-1, keepdim=True)
    steepness = torch.where(steepness < 0, -1.0, 1.0) * steepness.abs().clamp(min=_FLAT)
    shorter = leaving - 2 * (along * leaving).sum(-1, keepdim=True) / steepness * normal
    step = _STEP * shorter / (shorter.square().sum(-1, keepdim=True) + _CLEAR**2).sqrt()
    place = crossings.along.to(step)[:, None]
    weights = torch.cat([1 - place, place, -crossings.weights.to(step)], 1)
    step = step / weights.square().sum(1, keepdim=True)
    return _mean_steps(vertices, frame, torch.cat([ends, corners], 1), weights, step)


def _mean_steps(
    vertices: torch.Tensor,
    frame: torch.Tensor,
    movers: torch.Tensor,
    weights: torch.Tensor,
    step: torch.Tensor,
) -> torch.Tensor:
    """(T, R, 3): what each vertex moves, where `movers` (C, 5) move by `weights` (C, 5) of `step` (C, 3); the mean of
    steps by their weights where a vertex has several that weigh more than 1 together.
    """
    count = vertices.shape[1]
    steps = torch.cat([weights[..., None] * step[:, None], weights.abs()[..., None]], -1)
    total = vertices.new_zeros(len(vertices) * count, 4)
    total = total.index_add(0, (frame[:, None] * count + movers).flatten(), steps.flatten(0, 1))
    return (total[:, :3] / total[:, 3:].clamp(min=1)).reshape(vertices.shape)


def _lengths(vertices: torch.Tensor, patch: _Patch) -> torch.Tensor:
    """(T, E) metres."""
    first, second = patch.edges.unbind(1)
    lengths: torch.Tensor = torch.linalg.vector_norm(vertices[:, second] - vertices[:, first], dim=-1)
    return lengths


def _pulled(vertices: torch.Tensor, patch: _Patch, limits: Limits) -> torch.Tensor:
    """The vertices (T, R, 3) after one sweep towards edges that are neither too short nor too long."""
    first, second = patch.edges.unbind(1)
    span = vertices[:, second] - vertices[:, first]
    length = torch.linalg.vector_norm(span, dim=-1)
    wanted = length.clamp(min=limits[0], max=limits[1])
    pull = (0.5 * (1 - wanted / length.clamp(min=1e-9)))[..., None] * span
    off = (length != wanted)[..., None].to(pull)
    total = vertices.new_zeros(*vertices.shape[:2], 4)
    total = total.index_add(1, first, torch.cat([pull, off], -1))
    total = total.index_add(1, second, torch.cat([-pull, off], -1))
    step = _PULL * total[..., :3] / total[..., 3:].clamp(min=1)
    return torch.where(patch.loose[:, None], vertices + step, vertices)
