"""Images to tokens, a square patch each: a convolution whose steps are as long as its kernel, as a matrix product."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


class PatchEmbedding(nn.Conv2d):
    """A linear layer from the pixels of each patch to its token.

    Weights are those of a convolution. It is not computed as one: what PyTorch 2.13 takes for such convolutions in
    bfloat16 on processors with AMX units leaves out most of the weights where there are 4 to 31 channels.

    Args:
        channels: of the images. dim: of the tokens. patch: side, pixels.
    """

    def __init__(self, channels: int, dim: int, patch: int) -> None:
        super().__init__(channels, dim, patch, stride=patch)

    def forward(self, images: Tensor) -> Tensor:
        """(B, C, H, W), both sides multiples of the patch -> (B, H / patch, W / patch, dim)."""
        patch = self.stride[0]
        # (B, C, rows, patch, columns, patch)
        pixels = images.unflatten(3, (-1, patch)).unflatten(2, (-1, patch))
        rows = pixels.permute(0, 2, 4, 1, 3, 5).flatten(3)
        return functional.linear(rows, self.weight.flatten(1), self.bias)
