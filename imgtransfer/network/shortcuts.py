"""Shortcuts beside the paper's network, for trainings of minutes instead of days (`network.shortcuts`)."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

GRID = 8  # the body's image is averaged over 8 × 8 fields
FEATURES = 128


class PoseCode(nn.Module):
    """What the whole of a view of the body says to each garment token, without attention in between.

    Attention has to find out where to look before it can learn anything from what it sees; a dense layer over
    the coarse image does not.

    Args:
        views: S; their mean images differ.
        tokens: M, patches of an image.
        dim: width of the tokens.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, *, views: int, tokens: int, dim: int) -> None:
        super().__init__()
        self.dense = nn.Sequential(
            nn.Linear(3 * GRID**2, FEATURES), nn.GELU(), nn.Linear(FEATURES, tokens * dim)
        )
        self.dim = dim
        self.register_buffer("mean", torch.full((views, 3 * GRID**2), 0.5))
        self.register_buffer("scale", torch.tensor(0.25))

    def forward(self, body: Tensor) -> Tensor:
        """(B, S, H, W, 3) -> (B, S, M, dim)."""
        return self.dense((self._coarse(body) - self.mean) / self.scale).unflatten(-1, (-1, self.dim))

    @torch.no_grad()
    def calibrate(self, body: Tensor) -> None:
        """Take mean and spread of typical images (B, S, H, W, 3): most of an image is the same in every pose."""
        coarse = self._coarse(body)
        self.mean.copy_(coarse.mean(0))
        self.scale.copy_((coarse - self.mean).square().mean().sqrt().clamp(min=1e-3))

    def _coarse(self, body: Tensor) -> Tensor:
        """(B, S, H, W, 3) -> (B, S, 3 * GRID²)."""
        pooled = functional.adaptive_avg_pool2d(body.flatten(0, 1).movedim(-1, 1), GRID)
        return pooled.flatten(1).unflatten(0, body.shape[:2])
