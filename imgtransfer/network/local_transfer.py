"""The transfer network that sees the body from each patch of cloth (`network.local_view`), in place of its images.

Garment tokens, refinement and decoder are the paper's (section 3.2, equations 9 to 13); the body's tokens say how the
body around each patch has moved in that patch's own axes. Nothing is tied to one template: no position embedding, no
box, lengths in metres; where a patch is on the body and on the garment is told by what lies around it. The views see
each other, as the body's tokens and the garment's are those of all views.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from imgtransfer.network.config import NetworkConfig
from imgtransfer.network.decoder import Decoder
from imgtransfer.network.local_view import FEATURES, TEMPLATE_CHANNELS, TemplateView
from imgtransfer.network.places import PLACES
from imgtransfer.network.refinement import RefinementBlock
from imgtransfer.network.vit import VitBlock
from render import InputError

LEAST_SCALE_M = 1e-3  # of features: where nothing moved in the typical frames, noise is not made large


class TemplateEncoder(nn.Module):
    """The template at rest to tokens; they do not change while it is worn.

    Args:
        dim, depth, heads, patch: of `EncoderConfig`. dropout: of `NetworkConfig`.
    """

    def __init__(self, *, dim: int, depth: int, heads: int, patch: int, dropout: float) -> None:
        super().__init__()
        self.embed = nn.Conv2d(TEMPLATE_CHANNELS, dim, patch, stride=patch)
        self.around = nn.Linear(2 * PLACES, dim)
        self.blocks = nn.ModuleList(VitBlock(dim, heads, dropout) for _ in range(depth))

    def forward(self, template: TemplateView) -> Tensor:
        """(1 or B, S * M, dim), the views one after the other."""
        frames, views = template.images.shape[:2]
        patches = self.embed(template.images.flatten(0, 1)).flatten(2).mT.unflatten(0, (frames, views))
        tokens = (patches + self.around(template.places.flatten(2, 3))).flatten(1, 2)
        seen = template.covered.flatten(1)
        for block in self.blocks:
            tokens = block(tokens, seen=seen)
        return tokens


class LocalTransferNet(nn.Module):
    """f_p or f_n of equation 2, from the body around each patch.

    Args:
        config: sizes and switches, with `body: local`.
        size: (height, width) of the images, pixels.

    Raises:
        InputError: `size` is not a multiple of the patch.
    """

    scale: Tensor

    def __init__(self, config: NetworkConfig, size: tuple[int, int]) -> None:
        super().__init__()
        encoder = config.encoder
        dim, patch = encoder.dim, encoder.patch
        if size[0] % patch or size[1] % patch:
            raise InputError(
                f"maps.size is {size[0]}x{size[1]} (height x width), not a multiple of the {patch}-pixel patch "
                "(network.encoder.patch); change one of the two"
            )
        self.config = config
        self.grid = (size[0] // patch, size[1] // patch)
        times = 1 + len(config.history_s)
        self.encoder = TemplateEncoder(
            dim=dim, depth=encoder.depth, heads=encoder.heads, patch=patch, dropout=config.dropout
        )
        self.motion = nn.Sequential(nn.Linear(FEATURES * times, dim), nn.GELU(), nn.Linear(dim, dim))
        self.norm_motion = nn.LayerNorm(dim)
        self.refinement = nn.ModuleList(
            RefinementBlock(dim, config.heads, config.dropout) for _ in range(config.blocks)
        )
        self.norm = nn.LayerNorm(dim)
        levels = patch.bit_length() - 1
        # The two finest levels take most of a step's time; what they could add, the linear map from tokens has.
        self.decoder = Decoder(
            dim=dim, blocks=levels, linear=True, zero_start=True, interpolated=min(2, levels - 1)
        )
        self.register_buffer("scale", torch.full((PLACES + 1, times, 1), 0.05))

    def encode(self, template: TemplateView) -> Tensor:
        """(1 or B, S * M, dim) tokens of the template, for `forward`."""
        tokens: Tensor = self.encoder(template)
        return tokens

    def forward(self, template: TemplateView, local: Tensor, *, tokens: Tensor | None = None) -> Tensor:
        """Transfer a batch of frames.

        Args:
            template: of the garment.
            local: (B, S, rows, columns, K + 1, L, 3) float32, what `LocalView` tells of the frames.
            tokens: `encode(template)` of an earlier call.

        Returns:
            (B, S, H, W, 3) float32, the residual in the first guess's axes, see `network.model`. Values off the
            silhouette mean nothing.
        """
        tokens = self.encode(template) if tokens is None else tokens
        views = local.shape[1]
        motion = self.motion((local / self.scale).flatten(-3)).flatten(1, 3)
        garment = tokens + motion
        body, seen = self.norm_motion(motion), template.covered.flatten(1)
        for block in self.refinement:
            garment = block(garment, body, seen=seen)
        features = self.norm(garment).unflatten(1, (views, *self.grid)).flatten(0, 1).movedim(-1, 1)
        image = self.decoder(features).movedim(1, -1)
        return image.unflatten(0, (-1, views)).to(torch.float32)

    @torch.no_grad()
    def calibrate(self, typical: Sequence[Tensor]) -> None:
        """Take the features' scale at each place and time from typical frames.

        Args:
            typical: of each outfit (B, P, K + 1, L, 3), what its patches with cloth are told; all numbers count alike.
        """
        squared = torch.cat([told.square().mean(-1).flatten(0, 1) for told in typical]).mean(0)
        self.scale.copy_(squared.sqrt().clamp(min=LEAST_SCALE_M)[..., None])
