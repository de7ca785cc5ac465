"""The weights of a skinning decomposition, with bones as they are (Le and Deng 2012, section 4).

Each vertex has a problem of its own: least squares over weights that are not negative and sum to 1. It is solved for
all bones first; of these the K of greatest weight stay, and their weights are solved for exactly.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from imgtransfer.deformers.common.rigid_bones import Bones, homogeneous

_VERTICES = 512  # at once; their matrices are V x V each
_DESCENTS = 60  # steps of projected gradient descent, which only choose the bones
_RIDGE = 1e-9  # of the mean of the diagonal, where bones move a vertex alike
_LEAST_RIDGE = 1e-12  # m²; sums of squares below it are rounding


def solve_weights(
    rest: np.ndarray, moves: np.ndarray, bones: Bones, weights: np.ndarray, influences: int
) -> np.ndarray:
    """(N, V) float64, at most K a row above 0; no vertex fits worse than with `weights`.

    Args:
        rest: (N, 3). moves: (N, T, 3). weights: (N, V) to begin with, rows of sum 1. influences: K.
    """
    matrices = bones.matrices()
    count, points = len(bones), homogeneous(rest)
    flat = matrices.reshape(4 * count, -1)
    gram = (flat @ flat.T).reshape(count, 4, count, 4).transpose(1, 3, 0, 2).reshape(16, -1)
    solved = np.empty_like(weights)
    for first in range(0, len(rest), _VERTICES):
        part = slice(first, first + _VERTICES)
        own, path = points[part], moves[part].reshape(len(points[part]), -1)
        pairs = (own[:, :, None] * own[:, None]).reshape(-1, 16) @ gram
        cross = np.einsum("nva,na->nv", (path @ flat.T).reshape(-1, count, 4), own)
        residual = pairs.reshape(-1, count, count) - cross[:, None] - cross[:, :, None]
        residual += np.square(path).sum(axis=1)[:, None, None]  # of the weights' sum, which is 1
        solved[part] = _solve(residual, weights[part], min(influences, count))
    return solved


def _solve(quadratic: np.ndarray, weights: np.ndarray, influences: int) -> np.ndarray:
    """Minimise wᵀ H w over sparse weights on the simplex; H is (n, V, V)."""
    rows = np.arange(len(weights))[:, None]
    best = weights
    least = _value(quadratic, weights)
    descended = _descend(quadratic, weights)
    for start in (weights, descended):
        kept = np.argsort(-start, axis=1, kind="stable")[:, :influences]
        small = quadratic[rows[..., None], kept[:, :, None], kept[:, None]]
        candidate = np.zeros_like(weights)
        candidate[rows, kept] = simplex_minimum(small)
        value = _value(quadratic, candidate)
        sparse = (best > 0).sum(axis=1) <= influences
        better = (value < least) | ~sparse
        best = np.where(better[:, None], candidate, best)
        least = np.where(better, value, least)
    return best


def _value(quadratic: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("nv,nvw,nw->n", weights, quadratic, weights, optimize=True)


def _descend(quadratic: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Projected gradient descent with Nesterov's momentum, over all bones."""
    step = 1 / np.maximum(np.abs(quadratic).sum(axis=2).max(axis=1), 1e-300)[:, None]
    now, ahead, momentum = weights, weights, 1.0
    for _ in range(_DESCENTS):
        gradient = (quadratic @ ahead[..., None])[..., 0]
        after = onto_simplex(ahead - step * gradient)
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = after + (momentum - 1) / following * (after - now)
        now, momentum = after, following
    return now


def onto_simplex(points: np.ndarray) -> np.ndarray:
    """Rows (n, V) to the nearest ones that are not negative and sum to 1."""
    sorted_down = -np.sort(-points, axis=1)
    excess = sorted_down.cumsum(axis=1) - 1
    places = np.arange(1, points.shape[1] + 1)
    last = (sorted_down > excess / places).sum(axis=1)
    offset = excess[np.arange(len(points)), last - 1] / last
    return np.maximum(points - offset[:, None], 0)


def simplex_minimum(quadratic: np.ndarray) -> np.ndarray:
    """The weights w (n, K), not negative and of sum 1, that minimise wᵀ H w; exactly, for K of few.

    Every set of weights that may be above 0 is tried: with the others 0, w is H⁻¹ 1 scaled to sum 1.

    Args:
        quadratic: H, (n, K, K) positive semidefinite.
    """
    n, count = quadratic.shape[:2]
    ridge = _RIDGE * np.abs(np.einsum("nkk->n", quadratic)) / count + _LEAST_RIDGE
    best, least = np.zeros((n, count)), np.full(n, np.inf)
    for size in range(1, count + 1):
        for chosen in combinations(range(count), size):
            at = np.array(chosen)
            part = quadratic[:, at[:, None], at]
            solution = np.linalg.solve(part + ridge[:, None, None] * np.eye(size), np.ones((n, size, 1)))[
                ..., 0
            ]
            solution /= solution.sum(axis=1, keepdims=True)
            value = np.einsum("nv,nvw,nw->n", solution, part, solution)
            better = (solution >= 0).all(axis=1) & (value < least)
            weights = np.zeros((n, count))
            weights[:, at] = solution
            best = np.where(better[:, None], weights, best)
            least = np.where(better, value, least)
    return best
