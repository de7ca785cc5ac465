"""The image decoder: residual convolutions and transposed convolutions (section 3.2, equations 12 and 13)."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional


class DecoderBlock(nn.Module):
    """One of the L blocks: half the features, twice the resolution.

    Args:
        features: input features, even.
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        half = features // 2
        self.conv1 = nn.Conv2d(features, half, 3, padding=1)
        self.conv2 = nn.Conv2d(half, half, 3, padding=1)
        self.conv3 = nn.Conv2d(features, half, 3, padding=1)
        # Kernel 4 for stride 2: each output pixel gets equally many inputs, so no chequerboard.
        self.upsample = nn.ConvTranspose2d(half, half, 4, stride=2, padding=1)
        # PyTorch's own start values shrink the signal about fivefold in each of the first blocks; these keep its
        # variance. Swish passes about half of it on, the sum of equation 12 doubles it, and 4 of the 16 places of
        # the upsampling kernel meet in a pixel.
        for conv, inputs, gain in (
            (self.conv1, 9 * features, 0.7),
            (self.conv2, 9 * half, 1.0),
            (self.conv3, 9 * features, 1.4),
            (self.upsample, 4 * half, 1.0),
        ):
            nn.init.normal_(conv.weight, std=gain * inputs**-0.5)

    def forward(self, features: Tensor) -> Tensor:
        """(B, C, h, w) -> (B, C / 2, 2h, 2w)."""
        inner = self.conv3(functional.silu(features))
        return self.upsample(self.conv1(features) + self.conv2(functional.silu(inner)))  # equations 12 and 13


class Decoder(nn.Module):
    """L blocks and a last convolution to three channels.

    Args:
        dim: width of the tokens, a multiple of 2 ** blocks.
        blocks: L; log2 of the patch size returns to the image's resolution.
        linear: add a linear map from each token to its patch (`network.shortcuts`).
        zero_start: begin with an image that is 0 everywhere (a residual that changes nothing).
    """

    def __init__(self, *, dim: int, blocks: int, linear: bool, zero_start: bool) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(DecoderBlock(dim // 2**level) for level in range(blocks))
        self.to_image = nn.Conv2d(dim // 2**blocks, 3, 3, padding=1)
        self.linear = nn.ConvTranspose2d(dim, 3, 2**blocks, stride=2**blocks) if linear else None
        if zero_start:
            last = [self.to_image] if self.linear is None else [self.to_image, self.linear]
            for parameter in nn.ModuleList(last).parameters():
                nn.init.zeros_(parameter)

    def forward(self, features: Tensor) -> Tensor:
        """(B, dim, rows, columns) -> (B, 3, rows * 2 ** blocks, columns * 2 ** blocks)."""
        # The tokens' own layout; on CPUs the standard one takes up to 1.7 times as long.
        features = features.contiguous(memory_format=torch.channels_last)
        patches = 0 if self.linear is None else self.linear(features)
        for block in self.blocks:
            features = block(features)
        image: Tensor = self.to_image(functional.silu(features))
        return image + patches
