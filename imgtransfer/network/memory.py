"""How much memory networks and their training need at least, told before anybody makes them."""

from __future__ import annotations

from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.shortcuts import FEATURES
from render.memory import check_memory

_COPIES = 4  # of each weight in a training: itself, its gradient, and Adam's two moments
_KEPT = 12  # numbers a token, feature and block that the backward pass needs: norms, queries to values, the MLP's 4 + 4


def least_weights(network: NetworkConfig, maps: MapsConfig) -> int:
    """How many weights one transfer network has at least: attention and MLPs, position embedding, dense shortcuts."""
    encoder = network.encoder
    squares = 12 * encoder.depth + 16 * network.blocks  # of dim: four in an attention, eight in an MLP
    of_tokens = 0 if network.body == "local" else 1 + FEATURES * network.shortcuts
    return squares * encoder.dim**2 + _tokens(maps, encoder.patch) * encoder.dim * of_tokens


def check_training_memory(
    network: NetworkConfig, maps: MapsConfig, *, batch_frames: int, averaged: bool = False
) -> None:
    """Refuse networks and batches that cannot be trained in this machine's memory; what passes may still be too much.

    Args:
        network, maps: of the run. batch_frames: of a step. averaged: whether weights are kept averaged, too.

    Raises:
        InputError: less memory is free than weights and encoder need at least.
    """
    encoder = network.encoder
    weights = least_weights(network, maps)
    tokens = batch_frames * len(maps.views) * _tokens(maps, encoder.patch)
    kept = tokens * encoder.dim * encoder.depth * _KEPT
    check_memory(
        2 * 4 * ((_COPIES + averaged) * weights + kept),
        f"two networks of {weights} weights and batches of {batch_frames} frames of {maps.size[0]} x {maps.size[1]} "
        "pixels",
    )


def _tokens(maps: MapsConfig, patch: int) -> int:
    """Of one image."""
    return (maps.size[0] // patch) * (maps.size[1] // patch)
