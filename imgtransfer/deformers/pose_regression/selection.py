"""Kernel widths, joints and ridge, chosen by predicting training clips that are left out.

The kernel is exp(-Σ_j Σ_τ a_jτ |x_jτ - x'_jτ|²) over joints j and times τ (now, before). All a_jτ and the ridge are
found by gradient descent on the error of each group of clips when the regression is fitted to the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.training.left_out import left_out_errors, members, principal_components

_FIRST_WIDTH, _FIRST_RIDGE = -1.5, -2.5  # logarithms
_RATE = 0.1  # of Adam, in logarithms
_COMPONENTS = 40  # principal components of the targets that are predicted; they hold nearly all of them
_SLOWEST = 1e-5  # of a scale: a joint below does not count


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen.

    Args:
        joints: (J,) int, those that count most, in ascending order.
        scales: (J, 2) float64, √a of each joint, now and before.
        ridge: of the regression.
        error: root mean square over frames, mean over the groups that were left out, in the unit of the targets.
    """

    joints: np.ndarray
    scales: np.ndarray
    ridge: float
    error: float


def choose(
    features: np.ndarray, targets: np.ndarray, groups: np.ndarray, *, joints: int, steps: int
) -> Choice:
    """Choose widths and ridge for all joints, keep those that count most, and choose again for these.

    Args:
        features: (M, J, 2, 9), see `pose_features`. targets: (M, Y).
        groups: (M,) int, which frames are left out together; two groups at least.
        joints: how many to keep. steps: of the descent, each time.
    """
    components = _components(targets)
    everyone = np.arange(features.shape[1])
    first = _descend(features, components, groups, everyone, steps)
    spread = features.var(axis=0).sum(-1)  # (J, 2)
    influence = (first.scales**2 * spread).sum(axis=1)
    kept = np.sort(np.argsort(-influence, kind="stable")[:joints])
    return _descend(
        features[:, kept], components, groups, kept, steps, first=first.scales[kept], ridge=first.ridge
    )


def _components(targets: np.ndarray) -> Tensor:
    """The targets' principal components, (M, C)."""
    centred = targets.astype(np.float64) - targets.mean(axis=0, dtype=np.float64)
    return principal_components(torch.from_numpy(centred), _COMPONENTS)


def _descend(
    features: np.ndarray,
    targets: Tensor,
    groups: np.ndarray,
    joints: np.ndarray,
    steps: int,
    *,
    first: np.ndarray | None = None,
    ridge: float | None = None,
) -> Choice:
    distances = _distances(features)
    start = torch.full((distances.shape[0],), _FIRST_WIDTH, dtype=torch.float64)
    if first is not None:
        start = torch.from_numpy(2 * np.log(np.maximum(first.ravel(), np.sqrt(_SLOWEST))))
    widths = start.requires_grad_()
    strength = torch.tensor(
        _FIRST_RIDGE if ridge is None else np.log(ridge), dtype=torch.float64, requires_grad=True
    )
    optimizer = torch.optim.Adam([widths, strength], lr=_RATE)
    of_group = members(groups)
    counts = torch.tensor([len(group) for group in of_group])
    best = Choice(joints, np.empty(0), 0.0, np.inf)
    for _ in tqdm(range(steps), desc="widths", unit="step", leave=False, disable=None):
        squares = (widths.exp() @ distances.flatten(1)).reshape(distances.shape[1:])
        errors = left_out_errors(torch.exp(-squares), targets, strength.exp(), of_group)
        error = (errors / counts).sqrt().mean()
        if error.item() < best.error:
            scales = widths.detach().exp().sqrt().reshape(-1, 2).numpy()
            best = Choice(joints, scales, float(strength.detach().exp()), error.item())
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
    return best


def _distances(features: np.ndarray) -> Tensor:
    """(M, J, 2, 9) -> (2 J, M, M), squared, of each joint and time by itself."""
    each = torch.from_numpy(features).flatten(1, 2).transpose(0, 1)
    return torch.cdist(each, each).square()
