"""A recurrent network over windows of clips, and over clips of any length."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from imgtransfer.deformers.common.windows import warmed_up

_STILL, _LEAST = (
    1e-3,
    0.02,
)  # deviations of features: those below tell nothing, and no number is divided by less


class Standardise(nn.Module):
    """Features less their mean over the training, by their deviation there; 0 for joints that never moved.

    Args:
        features: (S, ..., C) of the training, of which each number has its own mean and deviation.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, features: Tensor) -> None:
        super().__init__()
        deviation = features.std(0, correction=0)
        self.register_buffer("mean", features.mean(0))
        self.register_buffer("scale", torch.where(deviation > _STILL, 1 / deviation.clamp(min=_LEAST), 0))

    def forward(self, features: Tensor) -> Tensor:
        """(..., C) of any frames; no further from the mean than five deviations, beyond which nothing was learned."""
        return ((features - self.mean) * self.scale).clamp(-5, 5)


class MotionGru(nn.Module):
    """Features (B, L, C) to what a gated recurrent unit remembers of them, (B, L, H).

    Args:
        features: (S, C) of all training frames, by which it standardises.
        hidden: H.
        dropout: part of what it remembers that each training step hides from what reads it.
    """

    def __init__(self, features: Tensor, hidden: int, dropout: float) -> None:
        super().__init__()
        self.standardise = Standardise(features)
        self.gru = nn.GRU(features.shape[-1], hidden, batch_first=True)
        self.dropout = nn.Dropout(dropout)

    def forward(self, features: Tensor) -> Tensor:
        """Of windows; nothing is remembered before their first frame."""
        return self.dropout(self.gru(self.standardise(features))[0])

    def whole(self, features: Tensor, warm_up: int) -> Tensor:
        """(T, C) of a whole clip -> (T, H), after its first frame was seen `warm_up` times more."""
        return self(warmed_up(features, warm_up)[None])[0, warm_up:]
