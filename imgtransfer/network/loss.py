"""How far predicted images are from the true ones: the loss of a training, and errors in millimetres and degrees."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from imgtransfer.network.maps import ImagePair
from render import PositionBox, decode_normals


def masked_l1(predicted: Tensor, truth: Tensor, mask: Tensor) -> Tensor:
    """Masked L1 loss (section 3.2, equation 3): mean absolute difference over the silhouette's pixels and channels.

    Args:
        predicted: (..., S, H, W, 3).
        truth: same shape.
        mask: (S, H, W) bool, the silhouette; or (..., S, H, W), one a frame.

    Returns:
        Shape (), in the images' unit; 0 for an empty mask. What lies in the background has no influence, not
        even on the gradient and not even where it is not finite.
    """
    shown = mask.expand(predicted.shape[:-1])[..., None]
    # Not by index, whose gradient is written pixel by pixel.
    difference = torch.where(shown, predicted - truth, predicted.new_zeros(())).abs()
    return difference.sum() / (predicted.shape[-1] * shown.sum()).clamp(min=1)


def map_errors(predicted: ImagePair, truth: ImagePair, mask: Tensor, box: PositionBox) -> dict[str, float]:
    """Mean errors over the covered pixels; not a number where no pixel is covered.

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


def frame_distances(predicted: ImagePair, truth: ImagePair, mask: Tensor, box: PositionBox) -> Tensor:
    """(B,) of each frame the mean distance to the true position over the covered pixels, metres; arguments as above."""
    metres = [box.decode(pair.positions[:, mask]) for pair in (predicted, truth)]
    return (metres[0] - metres[1]).norm(dim=-1).mean(dim=-1)
