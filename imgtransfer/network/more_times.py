"""Weights of local networks for a longer history than they were trained with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from imgtransfer.network.places import PLACES

_READS = (
    "motion.0.weight"  # (dim, (K + 1) * L * 3): the layer of `LocalTransferNet` that reads the body's motion
)


def with_more_times(
    state: Mapping[str, Tensor], known: Sequence[float], wanted: Sequence[float]
) -> dict[str, Tensor]:
    """A state of `TransferModel` with `body: local` that is told of the body at further times before the frame.

    What is told of the further times has no weight yet, so that the predictions are what they were. Its scale is that
    of the last known time, longer by how much farther the further ones lie back.

    Args:
        state: of a model with `network.history_s` `known`.
        known: seconds. wanted: seconds, those known and further ones after them.
    """
    added = len(wanted) - len(known)
    longer = dict(state)
    for name, values in state.items():
        if name.endswith(_READS):
            columns = values.unflatten(1, (PLACES + 1, -1, 3))
            none = columns.new_zeros(*columns.shape[:2], added, 3)
            longer[name] = torch.cat([columns, none], dim=2).flatten(1)
        elif name.endswith("_net.scale"):
            last = known[-1] if known else wanted[0]
            ratios = values.new_tensor([time / last for time in wanted[len(known) :]])
            longer[name] = torch.cat([values, values[:, -1:] * ratios[:, None]], dim=1)
    return longer
