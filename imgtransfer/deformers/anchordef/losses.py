"""AnchorDEF's losses. Norms are sums over vertices or anchors as in the paper, in m², and means over frames."""

from __future__ import annotations

import torch
from torch import Tensor

from render.mesh.normals import safe_normalize
from render.mesh.sparse import SparseProduct


def squared_distance(predicted: Tensor, target: Tensor) -> Tensor:
    """‖a − b‖² of (..., N, 3): the sum over the last two axes, the mean over the others (equation 6)."""
    return (predicted - target).square().sum((-2, -1)).mean()


def laplacian_loss(predicted: Tensor, target: Tensor, laplacian: SparseProduct) -> Tensor:
    """‖ΔV_pred − ΔV_gt‖² (equation 7); `laplacian` is linear, so that one product does."""
    return laplacian(predicted - target).square().sum((-2, -1)).mean()


def collision_loss(vertices: Tensor, points: Tensor, normals: Tensor, margin: float) -> Tensor:
    """How far vertices are behind the planes of their nearest body vertices (of equation 8, as Pan et al. 2022).

    Args:
        vertices: (..., N, 3). points, normals: (..., N, 3) of each one's body vertex.
        margin: metres in front of the plane at which the term ends.

    Returns:
        The sum over vertices of max(margin − distance, 0)², m², mean over frames.
    """
    distance = ((vertices - points) * normals).sum(-1)
    return (margin - distance).relu().square().sum(-1).mean()


def consistency_loss(
    anchors: Tensor, normals: Tensor, targets: Tensor, target_normals: Tensor, normal_weight: float
) -> Tensor:
    """‖p_G − p_tgt‖² + γ ‖n(p_G) − n(p_tgt)‖² of (..., A, 3) each (equation 10)."""
    return squared_distance(anchors, targets) + normal_weight * squared_distance(normals, target_normals)


def direction_loss(anchors: Tensor, targets: Tensor, target_normals: Tensor) -> Tensor:
    """1 − cos(p_G − p_tgt, n(p_tgt)) (equation 11), the mean over anchors; 1 for an anchor on its target."""
    return (1 - (safe_normalize(anchors - targets) * target_normals).sum(-1)).mean()


def chamfer_loss(anchors: Tensor, simplified: Tensor, valid: Tensor) -> Tensor:
    """Each anchor to its nearest simplified vertex, and the other way round, squared and summed (equation 12).

    Args:
        anchors: (S, A, 3). simplified: (S, M, 3). valid: (S, M) bool, vertices that are there.

    Returns:
        (), m², mean over the S frames.
    """
    squared = (anchors[:, :, None] - simplified[:, None]).square().sum(-1)  # (S, A, M)
    there = squared.masked_fill(~valid[:, None], torch.inf).min(2).values.sum(1)
    back = squared.min(1).values.masked_fill(~valid, 0).sum(1)
    return (there + back).mean()
