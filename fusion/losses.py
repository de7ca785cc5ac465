"""The terms that the fusion minimises: equations 5 to 7 of the paper.

Each returns one value a frame, shape (...), so that the frames of a batch stay independent
problems. Lengths are metres.
"""

from __future__ import annotations

import torch

from fusion.topology import Topology


def edge_length_loss(vertices: torch.Tensor, topology: Topology) -> torch.Tensor:
    """Mean over edges of the squared change of length against the template, in m² (equation 5).

    Args:
        vertices: (..., N, 3), metres.
        topology: of the template; holds edges and rest lengths.

    Returns:
        (...); 0 for the template itself and for every rigid motion of it.
    """
    lengths: torch.Tensor = torch.linalg.vector_norm(topology.difference(vertices), dim=-1)
    return (lengths - topology.rest_lengths.to(lengths)).square().mean(-1)


def normal_rendering_loss(
    rendered: torch.Tensor, target: torch.Tensor, confidence: torch.Tensor | None = None
) -> torch.Tensor:
    """Mean over covered pixels of the Euclidean distance between rendered and target normals (eq. 6, left).

    The paper writes a norm without saying how it is reduced. A mean does not depend on the resolution.

    Args:
        rendered: (..., P, 3), interpolated vertex normals at the P covered pixels of all views.
        target: (..., P, 3), unit normals of the maps there.
        confidence: (..., P), at least 0, what each pixel counts; 1 if None.

    Returns:
        (...), between 0 and 2 at confidence 1; 0 where P = 0. The gradient of a pixel that agrees exactly is 0.
    """
    distances: torch.Tensor = torch.linalg.vector_norm(rendered - target, dim=-1)
    if confidence is not None:
        distances = distances * confidence
    return distances.sum(-1) / max(distances.shape[-1], 1)


def normal_consistency_loss(normals: torch.Tensor, topology: Topology) -> torch.Tensor:
    """Mean over edges of 1 − cos(angle between the normals of its two vertices) (equation 6, right).

    Args:
        normals: (..., N, 3) unit vectors.
        topology: of the template.

    Returns:
        (...), between 0 (flat) and 2; an edge at a vertex without normal (0) counts 1.
    """
    # Every edge stands twice in the symmetric adjacency matrix A, so the sum over edges is half of Σ n · A n.
    agreement = (normals * topology.adjacency(normals)).sum((-2, -1)) / 2
    return 1 - agreement / topology.n_edges


def displacement_loss(
    vertices: torch.Tensor, anchor: torch.Tensor, vertex_weights: torch.Tensor | None = None
) -> torch.Tensor:
    """Mean over vertices of the squared distance to `anchor`, in m²: the regulariser L_rv of section 3.3.

    Args:
        vertices: (..., N, 3), metres.
        anchor: (..., N, 3), where the position maps put the vertices.
        vertex_weights: (N,) or (..., N), at least 0, what each vertex counts; vertices with 0 are free. None is the
            mean over all, 1 / N each; `anchor_weights` makes the others.

    Returns:
        (...), the weighted sum.
    """
    squared = (vertices - anchor).square().sum(-1)
    return squared.mean(-1) if vertex_weights is None else (squared * vertex_weights).sum(-1)


def anchor_weights(seen: torch.Tensor, confidence: torch.Tensor | None = None) -> torch.Tensor:
    """What each vertex counts in `displacement_loss`: alike for all that are seen, times their confidence.

    Args:
        seen: (N,) bool, vertices that a view sees; (..., N) where frames differ.
        confidence: (..., N), at least 0; 1 if None.

    Returns:
        (N,) or (..., N), 1 / (number seen in the frame) at confidence 1, and 0 where not seen.
    """
    weights = seen.to(torch.float32 if confidence is None else confidence.dtype)
    weights = weights / seen.sum(-1, keepdim=True).clamp(min=1)
    return weights if confidence is None else weights * confidence


def collision_loss(distance: torch.Tensor, *, margin_m: float = 0.0) -> torch.Tensor:
    """Mean over vertices of how deep each lies in the body, in metres (equation 7).

    Args:
        distance: (..., N) signed distance to the body, metres, negative inside.
        margin_m: metres of clearance below which a vertex already counts as inside; the paper's is 0.

    Returns:
        (...), at least 0; 0 once every vertex clears the margin, and for N = 0.
    """
    return (margin_m - distance).clamp(min=0).sum(-1) / max(distance.shape[-1], 1)
