"""A kernel head and those of left-out clips as files have them."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from imgtransfer.network import TransferModel
from imgtransfer.network.head_patches import template_patches
from imgtransfer.network.kernel_head import KernelHead, LeftOut, buffer_shapes, sizes_of
from render import InputError, Option


def empty_head(model: TransferModel, weights: dict[str, Tensor], path: Path) -> KernelHead:
    """A head with room for a file's weights "head.*".

    Raises:
        InputError: they are missing, or not of a head of this model.
    """
    own = {key.removeprefix("head."): value for key, value in weights.items() if key.startswith("head.")}
    network, mask = model.network, model.mask
    patches = template_patches(model.imager, token=network.vit.patch, count=network.head.patches)
    try:
        sizes = sizes_of(own)
        fits = {key: tuple(value.shape) for key, value in own.items()} == buffer_shapes(
            patches, int(mask.sum()), sizes
        ) and sizes.read in (0, 2 * network.vit.dim)
    except (KeyError, ValueError):
        fits = False
    if not fits:
        raise InputError(
            f"{path}: the weights are of another architecture (those of network.head do not fit it)"
        )
    return KernelHead(patches, mask, sizes).to(mask.device)


def check_trainable(head: KernelHead | None, folder: Path) -> None:
    """Raise InputError where steps would change networks that the head of the run in `folder` reads."""
    if head is not None and head.reads:
        raise InputError(
            f"{folder}: the head of this run reads the networks as they are, and training.steps above 0 would change "
            f"them; choose another {Option('out')} for a new run"
        )


def left_out_heads(tensors: dict[str, Tensor], head: KernelHead, group: Tensor, path: Path) -> LeftOut:
    """The tensors "left_out.*" of a training state.

    Args:
        tensors: of the state. head: of the model. group: (T,) int64, of each training frame. path: of the state.

    Raises:
        InputError: not those of heads like this one, for each of the groups.
    """
    groups = int(group.max()) + 1
    weights, offsets = (tensors.get(f"left_out.{key}", torch.empty(0)) for key in ("weights", "offsets"))
    wanted = [(groups, *head.weights.shape), (groups, *head.offset.shape)]
    if [tuple(weights.shape), tuple(offsets.shape)] != wanted or not (
        weights.isfinite().all() and offsets.isfinite().all()
    ):
        raise InputError(
            f"{path}: damaged, or the training data have changed since: the heads of its left-out clips do not fit; "
            f"choose another {Option('out')} for a new run"
        )
    return LeftOut(weights.to(head.weights), offsets.to(head.offset), group)
