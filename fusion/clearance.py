"""The last clean-up: no vertex stays in the body."""

from __future__ import annotations

import torch

from fusion.sdf import BodySdf
from fusion.topology import Topology

# Share of a lifted vertex's way that its neighbours go along, so that a single lifted vertex makes no spike.
_FOLLOW = 0.5


def clear_body(
    vertices: torch.Tensor, sdf: BodySdf, topology: Topology, *, clearance_m: float, rounds: int
) -> torch.Tensor:
    """Lift vertices that are nearer to the body than `clearance_m`, or inside it, along the distance's
    gradient.

    Neighbours that have clearance themselves follow half of the way, on average over their neighbours. In the
    last round nothing follows, so that it cannot push anything back in.

    Args:
        vertices: (T, N, 3) metres, not changed.
        sdf: one posed body a frame.
        topology: of the garment.
        clearance_m: metres, the distance that lifted vertices get.
        rounds: at most; fewer where all vertices are clear.

    Returns:
        (T, N, 3). Vertices may stay inside where limbs overlap and no way leads out.
    """
    degree = topology.adjacency(vertices.new_ones(topology.n_vertices, 1)).clamp(min=1)
    for number in range(rounds):
        found = sdf.query(vertices)
        missing = (clearance_m - found.distance).clamp(min=0)[..., None]
        # Rounding of a lifted vertex's own distance must not start another round.
        if not bool((missing > 1e-6).any()):
            break
        lift = (missing * found.direction).to(vertices)
        if number < rounds - 1:
            lift = torch.where(missing > 0, lift, _FOLLOW * topology.adjacency(lift) / degree)
        vertices = vertices + lift
    return vertices
