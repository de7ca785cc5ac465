"""The transfer network: (template image, posed-body image) -> image of the deformed garment (equation 2)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from imgtransfer.network.config import NetworkConfig
from imgtransfer.network.decoder import Decoder
from imgtransfer.network.encoders import build_encoder
from imgtransfer.network.hub_encoder import HubEncoder
from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.refinement import RefinementBlock
from imgtransfer.network.shortcuts import PoseCode
from imgtransfer.network.vit import VitBlock
from render import InputError


class TransferNet(nn.Module):
    """f_p or f_n of equation 2 (section 3.2 and appendix C); views are independent of each other.

    Args:
        config: sizes and switches.
        size: (height, width) of the images, pixels.
        views: S, for the shortcuts' statistics.
        architecture: of a pretrained encoder whose weights are to follow; None reads them (`build_hub_encoder`).

    Raises:
        InputError: `size` is not a multiple of the encoder's patch, or a pretrained encoder cannot be had.
    """

    def __init__(
        self,
        config: NetworkConfig,
        size: tuple[int, int],
        *,
        views: int = 2,
        architecture: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.config = config
        self.encoder = build_encoder(config.encoder, size, config.dropout, architecture)
        dim = self.encoder.dim
        if dim % config.heads:
            raise InputError(
                f"network.encoder: its tokens of {dim} features are not a multiple of network.heads ({config.heads}); "
                "change network.heads, or set network.encoder.dim"
            )
        self.refinement = nn.ModuleList(_refinement(config, dim) for _ in range(config.blocks))
        self.decoder = Decoder(
            dim=dim,
            blocks=self.encoder.patch.bit_length() - 1,
            linear=config.shortcuts,
            zero_start=config.target == "residual",
        )

        rows, columns = self.encoder.grid
        self.pose_code = None
        if config.shortcuts:
            self.pose_code = PoseCode(views=views, tokens=rows * columns, dim=dim)

    def encode(self, images: Tensor, hidden: Tensor | None = None) -> Tensor:
        """(B, S, H, W, 3) images, background 0 -> (B, S, P + M, dim) tokens: P of [CLS] and registers, M patches.

        Args:
            hidden: `hidden(images)` of an earlier call, of which the tokens then are.
        """
        if hidden is not None:
            assert isinstance(self.encoder, HubEncoder)
            tokens = self.encoder.tail(hidden.flatten(0, 1))
        else:
            tokens = self.encoder(images.flatten(0, 1).movedim(-1, 1))
        return tokens.unflatten(0, images.shape[:2])

    def hidden(self, images: Tensor) -> Tensor:
        """What the frozen trunk of a pretrained encoder makes of (B, S, H, W, 3) images: (B, S, ...)."""
        assert isinstance(self.encoder, HubEncoder)
        return self.encoder.trunk(images.flatten(0, 1).movedim(-1, 1)).unflatten(0, images.shape[:2])

    def forward(
        self,
        garment: Tensor,
        body: Tensor,
        *,
        garment_tokens: Tensor | None = None,
        body_hidden: Tensor | None = None,
    ) -> Tensor:
        """Transfer a batch of frames.

        Args:
            garment: (1 or B, S, H, W, 3) float32, template images in [0, 1].
            body: (B, S, H, W, 3) float32, images of the posed body by the same cameras.
            garment_tokens: (1 or B, S, P + M, dim), `encode(garment)` of an earlier call: the template does
                not change, so a prediction encodes it once.
            body_hidden: `hidden(body)` of an earlier call.

        Returns:
            (B, S, H, W, 3) float32, not clipped; what it means is `config.target`. Values off the garment's
            silhouette mean nothing.
        """
        if garment_tokens is None:
            garment_tokens = self.encode(garment)
        body_tokens = self.encode(body, body_hidden)
        tokens = self.begin(garment_tokens, body_tokens, body)
        for level in range(len(self.refinement)):
            tokens = self.refine(level, tokens, body_tokens)
        return self.decode(tokens, body.shape[:2])

    def begin(self, garment_tokens: Tensor, body_tokens: Tensor, body: Tensor) -> Tensor:
        """What the refinement begins with, (B * S, P + M, dim), from tokens and images as in `forward`."""
        tokens = garment_tokens.expand(len(body), -1, -1, -1).flatten(0, 1)
        if self.pose_code is not None:
            code = self.pose_code(body).flatten(0, 1)
            nothing = (0, 0, self.encoder.prefix, 0)  # for [CLS]
            return tokens + body_tokens.flatten(0, 1) + functional.pad(code, nothing)
        if self.config.attention == "added":
            return tokens + body_tokens.flatten(0, 1)
        return tokens

    def refine(self, level: int, tokens: Tensor, body_tokens: Tensor, other: Tensor | None = None) -> Tensor:
        """One block of the refinement, (B * S, P + M, dim) to the same.

        Args:
            level: which of the K.
            body_tokens: (B, S, P + M, dim), of the posed bodies.
            other: the other network's tokens before this block, with `attention: cross_modal`.
        """
        block = self.refinement[level]
        if self.config.attention == "added":
            return block(tokens)
        return block(tokens, body_tokens.flatten(0, 1), other)

    def decode(self, tokens: Tensor, frames: tuple[int, ...]) -> Tensor:
        """(B * S, P + M, dim) -> (B, S, H, W, 3) float32; `frames` is (B, S)."""
        # Without [CLS]: (B * S, dim, rows, columns).
        features = tokens[:, self.encoder.prefix :].unflatten(1, self.encoder.grid).movedim(-1, 1)
        image = self.decoder(features).movedim(1, -1)
        return image.unflatten(0, frames).to(torch.float32)


def _refinement(config: NetworkConfig, dim: int) -> nn.Module:
    """One block; with `attention: added` a plain one, equations 10 and 11 alone."""
    if config.attention == "added":
        return VitBlock(dim, config.heads, config.dropout)
    return RefinementBlock(dim, config.heads, config.dropout, cross_modal=config.attention == "cross_modal")


def build_transfer_net(
    network: NetworkConfig,
    size: tuple[int, int],
    views: int,
    architecture: dict[str, Any] | None = None,
) -> LocalTransferNet | TransferNet:
    """The network that `network.body` names, for images of `size` (height, width); see `TransferNet`."""
    if network.body == "local":
        return LocalTransferNet(network, size)
    return TransferNet(network, size, views=views, architecture=architecture)
