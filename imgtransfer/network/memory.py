"""How much memory networks and their training need at least, told before anybody makes them."""

from __future__ import annotations

from typing import Any

from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.encoders import EncoderSizes, encoder_sizes
from imgtransfer.network.shortcuts import FEATURES
from render.memory import check_memory

_COPIES = 4  # of each trained weight in a training: itself, its gradient, and Adam's two moments


def least_weights(
    network: NetworkConfig, maps: MapsConfig, architecture: dict[str, Any] | None = None
) -> int:
    """How many weights one transfer network has at least: attention and MLPs, position embedding, dense shortcuts.

    Args:
        architecture: of a pretrained encoder (`TransferModel.architecture`); None reads its checkpoint.
    """
    sizes = encoder_sizes(network.encoder, maps.size, architecture)
    return sizes.weights + _trained_weights(network, maps, sizes)


def check_training_memory(
    network: NetworkConfig, maps: MapsConfig, *, batch_frames: int, averaged: bool = False
) -> None:
    """Refuse networks and batches that cannot be trained in this machine's memory; what passes may still be too much.

    Args:
        network, maps: of the run. batch_frames: of a step. averaged: whether weights are kept averaged, too.

    Raises:
        InputError: less memory is free than weights and encoder need at least.
    """
    sizes = encoder_sizes(network.encoder, maps.size)
    others = _trained_weights(network, maps, sizes)
    trained, frozen = sizes.trained + others, sizes.weights - sizes.trained
    tokens = batch_frames * len(maps.views) * _tokens(maps, sizes.patch)
    numbers = (_COPIES + averaged) * trained + frozen + tokens * sizes.kept
    check_memory(
        2 * 4 * numbers,
        f"two networks of {trained + frozen} weights and batches of {batch_frames} frames of {maps.size[0]} x "
        f"{maps.size[1]} pixels",
    )


def _trained_weights(network: NetworkConfig, maps: MapsConfig, sizes: EncoderSizes) -> int:
    """Of one network without its encoder's blocks, at least."""
    of_tokens = 0 if network.body == "local" else network.encoder.kind == "vit"
    of_tokens += FEATURES * network.shortcuts
    squares = 16 * network.blocks  # of dim: four in an attention, eight in an MLP
    return squares * sizes.dim**2 + _tokens(maps, sizes.patch) * sizes.dim * of_tokens


def _tokens(maps: MapsConfig, patch: int) -> int:
    """Of one image."""
    return (maps.size[0] // patch) * (maps.size[1] // patch)
