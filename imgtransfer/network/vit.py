"""The image encoder: a vision transformer (Dosovitskiy et al. 2021) as DINO uses it (Caron et al. 2021)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from imgtransfer.network.attention import Attention, mlp, sine_cosine_grid
from imgtransfer.network.patch_embedding import PatchEmbedding
from render import InputError


class VitBlock(nn.Module):
    """Pre-norm transformer block: self-attention, then MLP."""

    def __init__(self, dim: int, heads: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.norm_attention = nn.LayerNorm(dim)
        self.attention = Attention(dim, heads, dropout)
        self.norm_mlp = nn.LayerNorm(dim)
        self.mlp = mlp(dim, dropout)

    def forward(self, tokens: Tensor, *, seen: Tensor | None = None) -> Tensor:
        """(B, M, dim) -> (B, M, dim); `seen` (1 or B, M) bool: which tokens the others look at, all if None."""
        normed = self.norm_attention(tokens)
        tokens = tokens + self.attention(normed, normed, seen=seen)
        return tokens + self.mlp(self.norm_mlp(tokens))


class VitEncoder(nn.Module):
    """Images to patch tokens, with a [CLS] token in front.

    Deviation from the original: the position embedding starts as sines and cosines instead of noise, which a short
    training from scratch needs; it is learned from there.

    Args:
        size: (height, width) of the images, pixels, multiples of `patch`.
        patch: side of a patch, pixels.
        dim: width of the tokens.
        depth: number of blocks.
        heads: attention heads in a block.
        dropout: see `NetworkConfig`.

    Raises:
        InputError: `size` is not a multiple of `patch`.
    """

    architecture = None  # of a pretrained encoder
    prefix = 1  # tokens before those of the patches

    def __init__(
        self, *, size: tuple[int, int], patch: int, dim: int, depth: int, heads: int, dropout: float = 0.0
    ) -> None:
        super().__init__()
        height, width = size
        if height % patch or width % patch:
            raise InputError(
                f"maps.size is {height}x{width} (height x width), not a multiple of the {patch}-pixel patch "
                "(network.encoder.patch); change one of the two"
            )
        self.size, self.patch, self.dim = size, patch, dim
        self.grid = (height // patch, width // patch)
        self.embed = PatchEmbedding(3, dim, patch)
        self.cls = nn.Parameter(0.02 * torch.randn(1, 1, dim))
        self.position = nn.Parameter(0.1 * sine_cosine_grid(self.grid, dim)[None])
        self.blocks = nn.ModuleList(VitBlock(dim, heads, dropout) for _ in range(depth))
        self.norm = nn.LayerNorm(dim)

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) in [0, 1] -> (B, 1 + rows * columns, dim), [CLS] first, patches row by row.

        Raises:
            InputError: the images are not of the encoder's size.
        """
        if tuple(images.shape[-2:]) != self.size:
            raise InputError(
                f"images are {images.shape[-2]}x{images.shape[-1]} (height x width), "
                f"but the encoder was made for {self.size[0]}x{self.size[1]}"
            )
        patches = self.embed((images - 0.5) / 0.25).flatten(1, 2) + self.position
        tokens = torch.cat([self.cls.expand(len(patches), -1, -1).to(patches.dtype), patches], dim=1)
        for block in self.blocks:
            tokens = block(tokens)
        return self.norm(tokens)
