"""A recurrent unit for each joint, which sees that joint, two neighbours and the root (section 3.2 of JointNet)."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn


class JointGru(nn.Module):
    """J gated recurrent units side by side, the same numbers as J of `torch.nn.GRU`.

    Args:
        joints: J. inputs: C, of each joint. hidden: H.
    """

    def __init__(self, joints: int, inputs: int, hidden: int) -> None:
        super().__init__()
        bound = 1 / math.sqrt(hidden)
        self.input_weight = _uniform(bound, joints, inputs, 3 * hidden)
        self.hidden_weight = _uniform(bound, joints, hidden, 3 * hidden)
        self.input_bias = _uniform(bound, joints, 1, 3 * hidden)
        self.hidden_bias = _uniform(bound, joints, 1, 3 * hidden)

    def forward(self, features: Tensor) -> Tensor:
        """(B, L, J, C) -> (B, L, J, H); nothing is remembered before the first frame."""
        count, length, joints, _ = features.shape
        by_joint = features.permute(2, 1, 0, 3).flatten(1, 2)  # joint, frame and window, input
        given = torch.baddbmm(self.input_bias, by_joint, self.input_weight).unflatten(1, (length, count))
        memory = features.new_zeros(joints, count, self.hidden_weight.shape[1])
        remembered = []
        for frame in given.unbind(1):
            own = torch.baddbmm(self.hidden_bias, memory, self.hidden_weight)
            reset, update, new = frame.chunk(3, -1)
            own_reset, own_update, own_new = own.chunk(3, -1)
            update = torch.sigmoid(update + own_update)
            new = torch.tanh(new + torch.sigmoid(reset + own_reset) * own_new)
            memory = new + update * (memory - new)
            remembered.append(memory)
        return torch.stack(remembered).permute(2, 0, 1, 3)


def _uniform(bound: float, *shape: int) -> nn.Parameter:
    return nn.Parameter(torch.empty(*shape).uniform_(-bound, bound))


def neighbour_joints(parents: np.ndarray) -> np.ndarray:
    """(J, 2) int64: each joint's parent and first child, the root's first two children; itself for what it lacks."""
    table = np.repeat(np.arange(len(parents))[:, None], 2, axis=1)
    for joint, parent in enumerate(parents):
        children = np.flatnonzero(parents == joint)
        near = [*children[:2]] if parent < 0 else [parent, *children[:1]]
        table[joint, : len(near)] = near
    return table


def joint_inputs(root: Tensor, joints: Tensor, neighbours: Tensor) -> Tensor:
    """(..., J, 27): the root's features, the joint's six numbers and those of its two neighbours.

    What the root does stands in its features, so that its own six numbers are 0.

    Args:
        root: (..., 9). joints: (..., J - 1, 6). neighbours: (J, 2).
    """
    every = torch.cat([torch.zeros_like(joints[..., :1, :]), joints], -2)
    near = every[..., neighbours, :].flatten(-2)
    return torch.cat([root[..., None, :].expand(*every.shape[:-1], -1), every, near], -1)
