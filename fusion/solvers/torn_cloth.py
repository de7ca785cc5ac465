"""Vertices so deep in an obstacle that its nearest side need not be theirs."""

from __future__ import annotations

import torch

from fusion.topology import Topology

# Metres of lift from which on a vertex may be beyond the middle of a limb, and be sent out on its far side.
_DEEP = 0.025
# An edge is torn that lifts make longer than this multiple of its length at rest, or before where that is more.
_TORN = 1.5


def torn_away(vertices: torch.Tensor, lift: torch.Tensor, topology: Topology) -> torch.Tensor:
    """Which vertices a lift tears away from the cloth around them.

    Of the two ends of a torn edge it is the one that is lifted farther: nearer to the middle of a limb.

    Args:
        vertices: (T, N, 3) metres.
        lift: (T, N, 3) metres that each is to move, 0 where it is outside.
        topology: of the garment.

    Returns:
        (T, N) bool.
    """
    height = torch.linalg.vector_norm(lift, dim=-1)
    torn = torch.zeros_like(height, dtype=torch.bool)
    if not bool((height > _DEEP).any()):
        return torn
    first, second = torch.from_numpy(topology.edges).to(vertices.device).T
    farther = torch.maximum(height[:, first], height[:, second]) > _DEEP
    frame, edge = farther.nonzero(as_tuple=True)
    ends = first[edge], second[edge]
    span = vertices[frame, ends[0]] - vertices[frame, ends[1]]
    before = torch.linalg.vector_norm(span, dim=-1)
    after = torch.linalg.vector_norm(span + lift[frame, ends[0]] - lift[frame, ends[1]], dim=-1)
    apart = after > _TORN * torch.maximum(before, topology.rest_lengths.to(before)[edge])
    frame, ends = frame[apart], (ends[0][apart], ends[1][apart])
    torn[frame, torch.where(height[frame, ends[0]] > height[frame, ends[1]], *ends)] = True
    return torn
