"""The masked L1 loss (section 3.2, equation 3)."""

from __future__ import annotations

from torch import Tensor


def masked_l1(predicted: Tensor, truth: Tensor, mask: Tensor) -> Tensor:
    """Mean absolute difference over the pixels that the garment's silhouette covers, and their three
    channels.

    Args:
        predicted: (..., S, H, W, 3).
        truth: same shape.
        mask: (S, H, W) bool, the silhouette.

    Returns:
        Shape (), in the images' unit; 0 for an empty mask. What lies in the background has no influence, not
        even on the gradient and not even where it is not finite.
    """
    difference = (predicted[..., mask, :] - truth[..., mask, :]).abs()
    return difference.sum() / max(difference.numel(), 1)
