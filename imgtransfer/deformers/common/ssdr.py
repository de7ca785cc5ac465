"""Skinning decomposition: rigid bones and sparse weights that move a mesh as it was seen to move (Le and Deng 2012).

Smooth skinning decomposition with rigid bones, SSDR, minimises

    sum_t sum_i |sum_v w^{i,v} (R_v^t u_i + T_v^t) - x_i^t|^2,

u_i being the vertices at rest and x_i^t those of frame t, over rigid bones (R, T) and weights that are not negative,
sum to 1 and are at most K a vertex. Bones and weights are solved for in turns, each time exactly or without getting
worse, from clusters of vertices that move rigidly. Sums over frames are matrix products, so that many cost little.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.deformers.common.rigid_bones import Bones, fit_cluster, moved, refine_bones
from imgtransfer.deformers.common.ssdr_weights import solve_weights
from render import one_blas_thread

_log = logging.getLogger(__name__)

_DEAD = 1e-6  # sum of a bone's weights below which it moves nothing
_NEAREST = 20  # vertices that a bone begins anew with


@dataclass(frozen=True, eq=False)
class Decomposition:
    """What SSDR gives.

    Args:
        weights: W, (N, V) float64, at most K of a row above 0, rows of sum 1.
        bones: (R, T) of every frame and bone.
        rms: after the clustering and after each round, metres; it never rises.
    """

    weights: np.ndarray
    bones: Bones
    rms: tuple[float, ...]


@one_blas_thread()
def decompose(
    rest: np.ndarray,
    positions: np.ndarray,
    *,
    bones: int,
    influences: int,
    clustering_rounds: int = 10,
    rounds: int = 15,
) -> Decomposition:
    """Decompose a mesh in motion.

    Args:
        rest: u, (N, 3), metres.
        positions: x, (T, N, 3), metres; without the motion of the body's root, which no bone then needs to follow.
        bones: V, fewer where there are fewer vertices.
        influences: K, bones a vertex at most.
        clustering_rounds: in which vertices change between rigid clusters, before the rounds of bones and weights.
    """
    rest, moves = rest.astype(np.float64), np.ascontiguousarray(positions.swapaxes(0, 1), np.float64)
    labels, found = _clusters(rest, moves, min(bones, len(rest)), clustering_rounds)
    weights = np.eye(len(found))[labels]
    rms = [_rms(rest, moves, weights, found)]
    for _ in range(rounds):
        weights = solve_weights(rest, moves, found, weights, influences)
        _revive(rest, moves, weights, found)
        found = refine_bones(rest, moves, weights, found)
        rms.append(_rms(rest, moves, weights, found))
    _log.info("%d bones leave %.2f mm (rms) of the training motion", len(found), 1e3 * rms[-1])
    return Decomposition(weights, found, tuple(rms))


def _clusters(rest: np.ndarray, moves: np.ndarray, count: int, rounds: int) -> tuple[np.ndarray, Bones]:
    """Vertices by the bone that moves them best: from nearest far points at rest on, as Lloyd does for k-means."""
    seeds = far_points(rest, count)
    _, labels = cKDTree(rest[seeds]).query(rest)
    for turn in range(rounds + 1):
        bones = Bones.stack([fit_cluster(rest, moves, labels == bone) for bone in range(count)])
        if turn == rounds:
            break
        errors = bones.errors(rest, moves)
        labels = errors.argmin(axis=1)
        smallest = errors[np.arange(len(rest)), labels]
        for bone in np.flatnonzero(np.bincount(labels, minlength=count) == 0):
            worst = int(smallest.argmax())  # an empty cluster begins where its neighbours fit worst
            labels[worst], smallest[worst] = bone, -1.0
    return labels, bones


def far_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices (count,) of points, each the farthest from those before it; the first is farthest from the middle."""
    distance = np.square(points - points.mean(axis=0)).sum(axis=1)
    chosen = [int(distance.argmax())]
    distance = np.square(points - points[chosen[0]]).sum(axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.square(points - points[chosen[-1]]).sum(axis=1))
    return np.array(chosen)


def _revive(rest: np.ndarray, moves: np.ndarray, weights: np.ndarray, bones: Bones) -> None:
    """Move bones that have lost all their vertices to where the error is greatest, in place; they weigh nothing yet."""
    dead = np.flatnonzero(weights.sum(axis=0) < _DEAD)
    if not len(dead):
        return
    error = np.square(moves - moved(rest, weights, bones)).sum(axis=(1, 2))
    tree = cKDTree(rest)
    for bone in map(int, dead):
        _, near = tree.query(rest[int(error.argmax())], k=min(_NEAREST, len(rest)))
        error[near] = 0
        near = np.isin(np.arange(len(rest)), near)
        bones.put(bone, fit_cluster(rest, moves, near))


def _rms(rest: np.ndarray, moves: np.ndarray, weights: np.ndarray, bones: Bones) -> float:
    squared = np.square(moves - moved(rest, weights, bones)).sum(axis=-1)
    return float(np.sqrt(squared.mean()))
