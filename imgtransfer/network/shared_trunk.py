"""The frozen weights of two pretrained encoders, which both networks of a model have: kept in memory once."""

from __future__ import annotations

import torch
from torch import nn


def share_trunks(first: nn.Module, second: nn.Module) -> None:
    """Let the second network's frozen weights lie in the first one's memory, as far as they are the same.

    They are where both come from one checkpoint, and stay so: nothing writes to them but reading a model's file, which
    has both. Whatever moves the networks to another device parts them again.

    Args:
        first, second: of the same architecture, on the same device.
    """
    known = _frozen(first)
    for name, weight in _frozen(second).items():
        mine = known.get(name)
        if mine is not None and mine.shape == weight.shape and torch.equal(mine, weight):
            weight.data = mine.data


def _frozen(network: nn.Module) -> dict[str, nn.Parameter]:
    """The weights that are never trained, by name."""
    return {name: weight for name, weight in network.named_parameters() if not weight.requires_grad}
