"""How far predicted maps are from the true ones."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from imgtransfer.network.maps import ImagePair
from render import PositionBox, decode_normals


def map_errors(predicted: ImagePair, truth: ImagePair, mask: Tensor, box: PositionBox) -> dict[str, float]:
    """Mean errors over the covered pixels.

    Args:
        predicted: encoded images, (B, S, H, W, 3) each; normals of any length.
        truth: the same.
        mask: (S, H, W) bool, the garment's silhouette.
        box: of the positions.

    Returns:
        position_mm, the distance to the true position in millimetres; normal_degrees, the angle to the true normal.
    """
    metres = [box.decode(pair.positions[:, mask]) for pair in (predicted, truth)]
    distance = (metres[0] - metres[1]).norm(dim=-1)
    units = [
        functional.normalize(decode_normals(pair.normals[:, mask]), dim=-1) for pair in (predicted, truth)
    ]
    angle = 2 * torch.asin((units[0] - units[1]).norm(dim=-1).clamp(max=2) / 2)  # exact for small angles too
    return {"position_mm": distance.mean().item() * 1000, "normal_degrees": angle.mean().rad2deg().item()}
