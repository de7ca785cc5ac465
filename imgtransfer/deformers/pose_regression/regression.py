"""Kernel ridge regression with scaled features, and the scale at which one kernel width suits all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

_WIDTH = 3.0  # of a kernel of one width, in median squared distances
_FEW = 1000  # features that these are the median of


@dataclass(frozen=True, eq=False)
class KernelRegression:
    """y(x) = m + Σ_i c_i k(x, x_i), k(x, x') = exp(-|x - x'|²), of features that are scaled already.

    Args:
        support: (M, D) float64, x_i. coefficients: (M, Y) float32, c_i. mean: (Y,) float32, m.
    """

    support: np.ndarray
    coefficients: np.ndarray
    mean: np.ndarray

    @classmethod
    def fit(cls, features: np.ndarray, targets: np.ndarray, ridge: float) -> KernelRegression:
        """c = (K + ridge I)⁻¹ (y - m), m being the mean of the targets.

        Args:
            features: (M, D), scaled. targets: (M, Y).
            ridge: above 0, in the unit of the kernel, which is 1 at distance 0.
        """
        mean = targets.mean(axis=0, dtype=np.float64)
        kernel = np.exp(-squared_distances(features, features))
        kernel[np.diag_indices(len(kernel))] += ridge
        factor = cho_factor(kernel, lower=True, overwrite_a=True, check_finite=False)
        coefficients = cho_solve(factor, targets - mean, overwrite_b=True, check_finite=False)
        return cls(features, coefficients.astype(np.float32), mean.astype(np.float32))

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """(T, D) scaled features -> (T, Y) float64."""
        kernel = np.exp(-squared_distances(features, self.support))
        return kernel @ self.coefficients + self.mean


def one_width(features: np.ndarray) -> float:
    """The scale of features (M, D) that makes the median squared distance of two of them 1/3; 1 where all are alike."""
    few = features[np.unique(np.linspace(0, len(features) - 1, min(len(features), _FEW)).round().astype(int))]
    median = float(np.median(squared_distances(few, few)))
    return 1.0 if median <= 0 else float(np.sqrt(1 / (_WIDTH * median)))


def squared_distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """|x - x'|² of (T, D) and (M, D): (T, M), in the numbers' type."""
    squares = (one**2).sum(-1)[:, None] + (other**2).sum(-1)[None] - 2 * one @ other.T
    return np.maximum(squares, 0)
