"""Frames that are left out of a fit, so that what it is set to can be chosen by them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor


def left_out_groups(clip_starts: np.ndarray, groups: int) -> Tensor:
    """(T,) of each frame the number of its clip's first -> (T,) int64, which group of clips it is left out with.

    Groups are of about as many frames each, and of clips that follow each other: clips of one kind often have names
    that do. A single clip is cut into parts.
    """
    frames = len(clip_starts)
    starts, clip, lengths = np.unique(clip_starts, return_inverse=True, return_counts=True)
    middle = np.arange(frames) + 0.5 if len(starts) == 1 else (starts + lengths / 2)[clip]
    _, group = np.unique(np.floor(groups * middle / frames), return_inverse=True)
    return torch.from_numpy(group.astype(np.int64))


def members(group: np.ndarray) -> list[Tensor]:
    """(n,) the group of each sample -> the samples of each group, int64, in the groups' order."""
    return [torch.from_numpy(np.flatnonzero(group == number)) for number in np.unique(group)]


def left_out_errors(kernel: Tensor, targets: Tensor, ridge: Tensor, groups: Sequence[Tensor]) -> Tensor:
    """What kernel ridge regression errs by on each group when it is fitted to the others.

    Returns:
        (G,) sums of squares of `left_out_residuals`.
    """
    residuals = left_out_residuals(kernel, targets, ridge, groups)
    return torch.stack([residuals[left].square().sum() for left in groups])


def left_out_residuals(kernel: Tensor, targets: Tensor, ridge: Tensor, groups: Sequence[Tensor]) -> Tensor:
    """What kernel ridge regression errs by on each sample when it is fitted to the other groups.

    Args:
        kernel: (n, n) of the samples. targets: (n, R). ridge: (), strength of the regularisation.
        groups: of each its samples, see `members`; every sample is in one.

    Returns:
        (n, R) predictions less targets, differentiable in all three.
    """
    errors = []
    for left in groups:
        rest = torch.ones(len(targets), dtype=torch.bool)
        rest[left] = False
        others = rest.nonzero()[:, 0]
        mean = targets[others].mean(dim=0)
        within = kernel[others][:, others] + ridge * torch.eye(len(others), dtype=kernel.dtype)
        weights = torch.cholesky_solve(targets[others] - mean, torch.linalg.cholesky(within))
        errors.append(kernel[left][:, others] @ weights + mean - targets[left])
    return torch.cat(errors)[torch.cat(list(groups)).argsort()]


def principal_components(centred: Tensor, count: int) -> Tensor:
    """Coordinates (n, at most `count`) of samples (n, A) of mean 0 along the directions in which they vary most."""
    values, vectors = torch.linalg.eigh(centred @ centred.T)  # n is far less than A
    return vectors[:, -count:] * values[-count:].clamp(min=0).sqrt()
