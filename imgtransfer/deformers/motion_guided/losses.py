"""The losses of sections 4.2 and 5. L1 norms are sums over axes and means over vertices and frames, metres."""

from __future__ import annotations

import torch
from torch import Tensor

from render.mesh.sparse import SparseProduct


def geometry_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """‖G − G*‖₁ of (B, N, 3)."""
    return (predicted - target).abs().sum(-1).mean()


def reconstruction_loss(predicted: Tensor, target: Tensor, laplacian: SparseProduct) -> Tensor:
    """L_rec = ‖G − G*‖₁ + ‖ΔG − ΔG*‖₁."""
    return geometry_loss(predicted, target) + laplacian(predicted - target).abs().sum(-1).mean()


def code_regularisation(code: Tensor) -> Tensor:
    """L_reg = |Σ z² / |Z| − 1| of codes (B, latent), mean over them."""
    return (code.square().mean(1) - 1).abs().mean()


def edge_loss(canonical: Tensor, rest: Tensor, edges: Tensor) -> Tensor:
    """L_rand = ‖Edge(Ĝ) − Edge(G_0)‖₁ of canonical garments (B, N, 3), mean over edges (E, 2)."""
    return (edge_lengths(canonical, edges) - edge_lengths(rest, edges)).abs().mean()


def edge_lengths(points: Tensor, edges: Tensor) -> Tensor:
    """(..., N, 3) -> (..., E), metres."""
    difference = points[..., edges[:, 0], :] - points[..., edges[:, 1], :]
    return (difference.square().sum(-1) + 1e-14).sqrt()  # a root has no gradient at 0


def clearance_loss(distance: Tensor, margin: float) -> Tensor:
    """L_SDF0 = max(ε − SDF_0, 0) of signed distances (B, N), mean, metres."""
    return (margin - distance).relu().mean()


def code_loss(code: Tensor, target: Tensor) -> Tensor:
    """‖Z − Z*‖₁, mean over all numbers."""
    return torch.nn.functional.l1_loss(code, target)
