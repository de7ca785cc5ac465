"""Edges that a clean-up has made too long, shortened again by what is around them."""

from __future__ import annotations

import torch

from fusion.obstacles.bvh import array, torch_stream, vectors
from fusion.topology import Topology
from fusion.warp_start import launch, warp_module

# Edges get no longer than this multiple of their rest length, or than they were where that is more.
_LONGEST = 1.05
# Sweeps over the edges, in each of which a vertex moves by the mean that its too long edges ask for, times the second.
_SWEEPS, _OVER = 10, 1.5


class EdgeLimits:
    """What edges may measure at most: as much as at the start, or a little more than at rest.

    Args:
        vertices: (T, N, 3) metres, at the start.
        topology: of the garment.
        loose: (N,) bool, vertices that may move.
    """

    def __init__(self, vertices: torch.Tensor, topology: Topology, loose: torch.Tensor) -> None:
        self._start, self._loose = vertices, loose
        self._edges = torch.from_numpy(topology.edges).to(vertices.device)
        self._rest = topology.rest_lengths.to(vertices)

    def excess(self, vertices: torch.Tensor) -> torch.Tensor:
        """(T,) the largest length of an edge over its limit, less 1; 0 where none is too long."""
        moved = (vertices != self._start).any(-1)
        frame, ends, longest = self._limited(moved)
        ratio = _lengths(vertices.reshape(-1, 3), ends) / longest.clamp(min=1e-12) - 1
        return vertices.new_zeros(len(vertices)).scatter_reduce(0, frame, ratio, "amax")

    def kept(self, vertices: torch.Tensor, walls: torch.Tensor, frames: torch.Tensor) -> torch.Tensor:
        """Vertices (T, N, 3) with edges that are shorter where they were too long; the others as they are.

        Args:
            vertices: (T, N, 3) metres, moved since the start.
            walls: (T, N, 3) unit vectors away from what a vertex touches, which it does not move against; 0 where that
                is nothing.
            frames: (T,) bool, which ones.
        """
        moved = (vertices != self._start).any(-1) & frames[:, None]
        _, ends, longest = self._limited(moved)
        used = torch.zeros(vertices.shape[:-1].numel(), dtype=torch.bool, device=vertices.device)
        used[ends] = True
        numbers, ends = used.nonzero()[:, 0], (used.cumsum(0) - 1)[ends]
        points, wall = vertices.reshape(-1, 3)[numbers], walls.reshape(-1, 3)[numbers]
        points = _swept(points, ends, longest, wall, self._loose[numbers % vertices.shape[1]])
        return vertices.reshape(-1, 3).index_copy(0, numbers, points).reshape(vertices.shape)

    def _limited(self, moved: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Edges at vertices `moved` (T, N): frames (K,), ends (K, 2) counted on over the frames, limits (K,)."""
        frames = moved.any(1).nonzero()[:, 0]
        by_vertex = moved[frames].T.contiguous()  # rows are gathered faster than columns
        first, second = (by_vertex[ends] for ends in self._edges.T)
        row, edge = (first | second).T.nonzero(as_tuple=True)
        frame = frames[row]
        ends = frame[:, None] * moved.shape[1] + self._edges[edge]
        before = _lengths(self._start.reshape(-1, 3), ends)
        return frame, ends, torch.maximum(before, _LONGEST * self._rest[edge])


def _lengths(points: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
    """(K,) metres between points (P, 3) by their numbers (K, 2)."""
    lengths: torch.Tensor = torch.linalg.vector_norm(points[ends[:, 0]] - points[ends[:, 1]], dim=-1)
    return lengths


def _swept(
    points: torch.Tensor, ends: torch.Tensor, longest: torch.Tensor, walls: torch.Tensor, loose: torch.Tensor
) -> torch.Tensor:
    """Points (P, 3), some `loose` (P,), after all sweeps; edges have ends (K, 2), limits (K,), points walls (P, 3)."""
    from fusion.obstacles.edge_kernels import move_points, pull_ends  # noqa: PLC0415 (defining kernels imports warp)

    start, wall, limits = (values.to(torch.float32).contiguous() for values in (points, walls, longest))
    moved, places, free = start.clone(), ends.int().contiguous(), loose.to(torch.int8)
    pulls = moved.new_zeros(len(moved), 4)
    warp, device = warp_module(), points.device
    sums = warp.from_torch(pulls, dtype=warp.vec4, return_ctype=True)
    pulling = [vectors(moved), array(places), array(limits), sums]
    moving = [_OVER, array(free), vectors(wall), vectors(moved), sums]
    with torch_stream(device):
        for _ in range(_SWEEPS if len(places) else 0):
            for kernel, count, inputs in (
                (pull_ends, len(places), pulling),
                (move_points, len(moved), moving),
            ):
                launch(kernel, dim=count, inputs=inputs, device=warp.device_from_torch(device))
    return points + (moved - start).to(points)  # what has not moved stays to the bit in float64, too
