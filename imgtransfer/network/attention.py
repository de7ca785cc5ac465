"""Multi-head attention and the MLP, the two layers that encoder and refinement share."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class Attention(nn.Module):
    """Multi-head attention (Vaswani et al. 2017).

    Args:
        dim: width of the tokens, a multiple of `heads`.
        heads: number of heads.
        dropout: fraction of the output that a training step leaves out.
    """

    def __init__(self, dim: int, heads: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(dim, dim)
        self.key_value = nn.Linear(dim, 2 * dim)
        self.output = nn.Linear(dim, dim)
        self.dropout = dropped(dropout)

    def forward(self, tokens: Tensor, context: Tensor, *, seen: Tensor | None = None) -> Tensor:
        """(B, M, dim) queries and (B, M', dim) keys and values -> (B, M, dim).

        For self-attention pass the same twice. `seen` (1 or B, M') bool: which of the context counts, at least one;
        all if None.
        """
        query = self._split(self.query(tokens))
        key, value = (self._split(part) for part in self.key_value(context).chunk(2, dim=-1))
        # Written out, not scaled_dot_product_attention: for the few tokens here (65 to 257) a layer with its
        # CPU kernel takes two to three times as long in bfloat16, forward and backward; about as long in
        # float32 (scripts/bench/training.py).
        scores = (query * query.shape[-1] ** -0.5) @ key.mT
        if seen is not None:
            scores = scores.masked_fill(~seen[:, None, None], -torch.inf)
        weights = torch.softmax(scores, dim=-1)
        return self.dropout(self.output((weights @ value).transpose(1, 2).flatten(2)))

    def _split(self, tokens: Tensor) -> Tensor:
        """(B, M, dim) -> (B, heads, M, dim / heads)."""
        return tokens.unflatten(-1, (self.heads, -1)).transpose(1, 2)


def mlp(dim: int, dropout: float = 0.0) -> nn.Sequential:
    """Linear layers of [4 dim, dim] with GELU between (appendix C: [3072, 768]), and dropout of what they give."""
    return nn.Sequential(nn.Linear(dim, 4 * dim), nn.GELU(), nn.Linear(4 * dim, dim), dropped(dropout))


def dropped(fraction: float) -> nn.Module:
    """Dropout; without any, a layer that does nothing, since PyTorch's draws numbers for a fraction of 0, too."""
    return nn.Dropout(fraction) if fraction else nn.Identity()


def sine_cosine_grid(grid: tuple[int, int], dim: int) -> Tensor:
    """Start values of a position embedding: sines and cosines of row and column (He et al. 2022, MAE).

    Args:
        grid: (rows, columns) of patches.
        dim: a multiple of 4.

    Returns:
        (rows * columns, dim) float32, row-major; the first half of the features tells the row.
    """
    frequency = 100.0 ** -torch.linspace(0, 1, dim // 4)
    rows, columns = torch.meshgrid(*(torch.arange(n, dtype=torch.float32) for n in grid), indexing="ij")
    places = torch.stack([rows.flatten(), columns.flatten()], dim=1)
    angle = places[..., None] * frequency  # (M, 2 axes, dim/4)
    return torch.cat([angle.sin(), angle.cos()], dim=-1).flatten(1)
