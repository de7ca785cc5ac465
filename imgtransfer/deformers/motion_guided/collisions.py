"""The last stage of a frame: a residual map of displacements that takes the garment out of the body (section 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.maps import TextureMaps
from render.mesh.sparse import SparseProduct


@dataclass(frozen=True, eq=False)
class Surface:
    """A body in one frame: vertices and normals (B, 3)."""

    vertices: Tensor
    normals: Tensor


def depths(garment: Tensor, body: Surface, tree: cKDTree) -> Tensor:
    """How far each vertex (N, 3) is behind the plane of its nearest body vertex, ReLU(−o) (N,), metres."""
    _, nearest = tree.query(garment.detach().numpy())
    index = torch.from_numpy(nearest)
    return -((garment - body.vertices[index]) * body.normals[index]).sum(-1).clamp(max=0)


def resolved(
    garment: Tensor,
    turned_axes: Tensor,
    body: Surface,
    *,
    maps: TextureMaps,
    laplacian: SparseProduct,
    config: MotionGuidedConfig,
) -> Tensor:
    """A garment with its collisions resolved, or as it was where they are few.

    L_Θ = ‖G̃ − G‖₁ + ‖ΔG̃ − ΔG‖₁ + λ3 Σ ReLU(−o), all as sums over vertices, is minimised over a map Θ of displacements
    by Adam; weights stay, so that G̃ = G + (Σ_j w_ij R_j) H_0 θ_i. Nearest body vertices are found anew in each step.

    Args:
        garment: (N, 3) G. turned_axes: (N, 3, 3) of each vertex, the blended rotation times H_0.

    Returns:
        (N, 3), the best of all steps by L_Θ.
    """
    tree = cKDTree(body.vertices.numpy())
    if not config.residual_steps or float(depths(garment, body, tree).sum()) <= config.residual_threshold_m:
        return garment
    residual = torch.zeros(1, 3, maps.size, maps.size, requires_grad=True)
    optimizer = torch.optim.Adam([residual], lr=config.residual_rate_m)
    best, lowest = garment, torch.inf
    for step in range(config.residual_steps + 1):
        with torch.enable_grad():
            moved = (turned_axes @ maps.at_vertices(residual)[0][..., None])[..., 0]
            depth = depths(garment + moved, body, tree)
            loss = moved.abs().sum() + laplacian(moved).abs().sum() + config.residual_collision * depth.sum()
        if loss.item() < lowest:
            best, lowest = (garment + moved).detach(), loss.item()
        if step < config.residual_steps:
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    return best
