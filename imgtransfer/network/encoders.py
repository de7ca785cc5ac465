"""The encoder that a configuration names, and how large it is, known before it is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from imgtransfer.network.encoder_config import EncoderConfig, HubEncoderConfig
from imgtransfer.network.hub_encoder import HubEncoder, build_hub_encoder, outline
from imgtransfer.network.vit import VitEncoder


def build_encoder(
    config: EncoderConfig | HubEncoderConfig,
    size: tuple[int, int],
    dropout: float = 0.0,
    architecture: dict[str, Any] | None = None,
) -> VitEncoder | HubEncoder:
    """The encoder that `config.kind` names, for images of `size` (height, width).

    Args:
        dropout: of blocks trained from scratch; a pretrained encoder has none.
        architecture: see `build_hub_encoder`.

    Raises:
        InputError: sizes that do not suit, or a checkpoint that cannot be read.
    """
    if isinstance(config, HubEncoderConfig):
        return build_hub_encoder(config, size, architecture)
    return VitEncoder(
        size=size,
        patch=config.patch,
        dim=config.dim,
        depth=config.depth,
        heads=config.heads,
        dropout=dropout,
    )


@dataclass(frozen=True)
class EncoderSizes:
    """How large an encoder is.

    Args:
        dim: features of a token. patch: pixels along its side.
        weights: how many it has at least. trained: how many of them are trained.
        kept: numbers a token that the backward pass needs.
    """

    dim: int
    patch: int
    weights: int
    trained: int
    kept: int


_KEPT = 12  # numbers a token, feature and block that the backward pass needs: norms, queries to values, the MLP's 4 + 4


def encoder_sizes(
    config: EncoderConfig | HubEncoderConfig,
    size: tuple[int, int],
    architecture: dict[str, Any] | None = None,
) -> EncoderSizes:
    """The sizes of `build_encoder` with the same arguments, without making it.

    Raises:
        InputError: as `build_encoder`, but for the weights.
    """
    if isinstance(config, HubEncoderConfig):
        made = outline(config, size, architecture)
        trained = sum(weight.numel() for weight in made.parameters() if weight.requires_grad)
        weights = sum(value.numel() for value in made.state_dict().values())
        return EncoderSizes(
            made.dim, made.patch, weights, trained, config.trained_blocks * made.features * _KEPT
        )
    weights = 12 * config.depth * config.dim**2  # four in an attention, eight in an MLP
    return EncoderSizes(config.dim, config.patch, weights, weights, config.depth * config.dim * _KEPT)
