"""Kernel ridge regression in closed form: with a Matern kernel, on some support samples, and with groups left out.

All samples count, also where only some are support (the Nystroem approximation): of the sums of kernels at the support
samples the one is taken that minimises the squared errors at all samples plus `ridge` times its squared norm. With
every sample as support that is the usual kernel ridge regression. That a left-out group is among the support tells
nothing of its targets: it only adds functions to choose from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

_JITTER = 1e-9  # samples may be equal: bodies that stand still
_FOR_WIDTH = 512  # samples that tell the typical distance


@dataclass(frozen=True)
class Regression:
    """Sums of kernels: one fitted to all samples, and one to those outside of each group.

    Args:
        width: squared length by which distances are divided, see `matern`.
        weights: (1 + G, M, R) float64, of the support samples; the first fitted to all samples.
        offsets: (1 + G, R) float64, added.
    """

    width: float
    weights: np.ndarray
    offsets: np.ndarray

    def __call__(self, features: np.ndarray, support: np.ndarray, which: int = 0) -> np.ndarray:
        """(B, D) features, (M, D) those of the support -> (B, R) values of function `which`."""
        kernel = matern(squared_distances(features, support), self.width)
        return kernel @ self.weights[which] + self.offsets[which]


def fit_ridge(
    features: np.ndarray,
    targets: np.ndarray,
    *,
    support: np.ndarray,
    group: np.ndarray,
    width: float,
    ridge: float,
) -> Regression:
    """Fit targets, and again without each group of samples.

    Args:
        features: (N, D).
        targets: (N, R).
        support: (M,) int, which samples are support.
        group: (N,) int in [0, G), the samples that are left out together.
        width: squared length by which distances are divided, see `matern`; `typical_width` of the samples, say.
        ridge: strength of the regularisation; the kernel is 1 at distance 0.
    """
    features, targets = features.astype(np.float64), targets.astype(np.float64)
    centres = features[support]
    own = matern(squared_distances(centres, centres), width)
    own[np.diag_indices(len(own))] += _JITTER
    root = cholesky(own, lower=True, overwrite_a=True, check_finite=False)
    kernel = matern(squared_distances(centres, features), width)
    # Orthonormal functions at the samples, so that the norm is that of their weights: (M, N).
    basis = solve_triangular(root, kernel, lower=True, overwrite_b=True, check_finite=False)
    groups = range(int(group.max()) + 1)
    grams = [basis[:, group == left] @ basis[:, group == left].T for left in groups]
    total = np.sum(grams, axis=0)
    weights, offsets = [], []
    for left in (None, *groups):
        rows = np.ones(len(group), bool) if left is None else group != left
        offset = targets[rows].mean(axis=0) if rows.any() else np.zeros(targets.shape[1])
        gram = total if left is None else total - grams[left]
        gram = gram + ridge * np.eye(len(gram))
        right = basis[:, rows] @ (targets[rows] - offset)
        solved = cho_solve(cho_factor(gram, overwrite_a=True, check_finite=False), right, check_finite=False)
        weights.append(solve_triangular(root, solved, lower=True, trans=1, check_finite=False))
        offsets.append(offset)
    return Regression(width, np.stack(weights), np.stack(offsets))


def matern(squared: np.ndarray, width: float) -> np.ndarray:
    """The Matern kernel of smoothness 3/2, (1 + r) exp(-r) with r² = 3 `squared` / `width`."""
    r = np.sqrt(squared * (3 / width))
    return (1 + r) * np.exp(-r)


def squared_distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(A, D) and (B, D) -> (A, B) squared distances, not below 0."""
    squared = np.square(first).sum(1)[:, None] + np.square(second).sum(1) - 2 * first @ second.T
    return np.maximum(squared, 0, out=squared)


def typical_width(features: np.ndarray, smoothness: float) -> float:
    """The width of a kernel whose length is `smoothness` typical distances between samples (N, D)."""
    some = features[:: -(-len(features) // _FOR_WIDTH)]
    return typical_distance(squared_distances(some, some)) * 2 * smoothness**2


def typical_distance(squared: np.ndarray) -> float:
    """The median of the squared distances (N, N) between different samples; 1 where all are equal."""
    apart = squared[np.triu_indices(len(squared), 1)]
    median = float(np.median(apart)) if len(apart) else 0.0
    return median if median > 0 else 1.0
