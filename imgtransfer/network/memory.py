"""How much memory networks and their training need at least, told before anybody makes them."""

from __future__ import annotations

from typing import Any

from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.encoders import EncoderSizes, encoder_sizes
from imgtransfer.network.shortcuts import FEATURES
from render.memory import check_memory

_COPIES = 4  # of each trained weight in a training: itself, its gradient, and Adam's two moments
_REFINED = (
    20  # numbers a token, feature and refinement block: norms, two times queries to values, the MLP's 4 + 4
)
_DECODED = 5  # numbers a token and feature of a decoder block's input


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
    tokens = batch_frames * len(maps.views) * _tokens(maps, sizes.patch)
    check_memory(
        _of_weights(network, maps, sizes, averaged=averaged) + 2 * 4 * tokens * sizes.kept,
        f"two networks of {sizes.weights + _trained_weights(network, maps, sizes)} weights and batches of "
        f"{batch_frames} frames of {maps.size[0]} x {maps.size[1]} pixels",
    )


def training_bytes(
    network: NetworkConfig, maps: MapsConfig, *, batch_frames: int, averaged: bool = False
) -> int:
    """About how much memory both networks and what a step keeps of a batch take, in float32.

    Frames that are kept in memory (`data.cache_gb`) and what PyTorch itself takes come on top.

    Args:
        network, maps, batch_frames, averaged: see `check_training_memory`.
    """
    sizes = encoder_sizes(network.encoder, maps.size)
    images, of_image = batch_frames * len(maps.views) * maps.layers, _tokens(maps, sizes.patch)
    # The garment's tokens and the body's in the encoder, then the garment's alone.
    kept = 2 * of_image * sizes.kept
    kept += network.blocks * (_REFINED * of_image * sizes.dim + 4 * network.heads * of_image**2)
    if network.body == "images":  # twice as many numbers from level to level
        kept += _DECODED * of_image * sizes.dim * (sizes.patch - 1)
    return _of_weights(network, maps, sizes, averaged=averaged) + 2 * 4 * images * kept


def _of_weights(network: NetworkConfig, maps: MapsConfig, sizes: EncoderSizes, *, averaged: bool) -> int:
    """Bytes of both networks' weights and of what a training keeps for each."""
    trained = sizes.trained + _trained_weights(network, maps, sizes)
    frozen = sizes.weights - sizes.trained  # in memory once (`shared_trunk`)
    return 4 * (2 * (_COPIES + averaged) * trained + frozen)


def _trained_weights(network: NetworkConfig, maps: MapsConfig, sizes: EncoderSizes) -> int:
    """Of one network without its encoder's blocks, at least."""
    of_tokens = 0 if network.body == "local" else network.encoder.kind == "vit"
    of_tokens += FEATURES * network.shortcuts
    attentions = {"added": 1, "body": 2, "cross_modal": 3}[network.attention]
    squares = (4 * attentions + 8) * network.blocks  # of dim: four in an attention, eight in an MLP
    return squares * sizes.dim**2 + _tokens(maps, sizes.patch) * sizes.dim * of_tokens


def _tokens(maps: MapsConfig, patch: int) -> int:
    """Of one image."""
    return (maps.size[0] // patch) * (maps.size[1] // patch)
