"""Rigid bones in motion, and their closed-form fits (Kabsch 1976; Le and Deng 2012, section 5).

Vertices in motion stand as (N, T, 3) here, one vertex after the other, which is what sums over a bone's vertices want.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imgtransfer.deformers.common.rotations import nearest_rotation


@dataclass(frozen=True, eq=False)
class Bones:
    """Rigid transforms x = R u + T of V bones in T frames.

    Args:
        rotation: (V, T, 3, 3) float64. translation: (V, T, 3) float64, metres.
    """

    rotation: np.ndarray
    translation: np.ndarray

    def __len__(self) -> int:
        return len(self.rotation)

    @classmethod
    def stack(cls, bones: Sequence[tuple[np.ndarray, np.ndarray]]) -> Bones:
        """Of rotations (T, 3, 3) and translations (T, 3), a pair a bone."""
        return cls(np.stack([turn for turn, _ in bones]), np.stack([shift for _, shift in bones]))

    def put(self, bone: int, transform: tuple[np.ndarray, np.ndarray]) -> None:
        """Replace a bone's transforms in place."""
        self.rotation[bone], self.translation[bone] = transform

    def matrices(self) -> np.ndarray:
        """(V, 4, 3 T): what homogeneous vertices at rest (N, 4) are multiplied by to give (N, 3 T)."""
        turn = self.rotation.transpose(0, 3, 1, 2)  # u's axis, frame, x's axis
        return np.concatenate([turn, self.translation[:, None]], axis=1).reshape(len(self), 4, -1)

    def errors(self, rest: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(N, V) sum over frames of the squared distance of each vertex moved by one bone alone, m²."""
        matrices, points = self.matrices(), homogeneous(rest)
        gram = matrices @ matrices.swapaxes(1, 2)
        flat = moves.reshape(len(rest), -1)
        own = np.einsum("na,vab,nb->nv", points, gram, points, optimize=True)
        cross = np.einsum("na,vna->nv", points, flat @ matrices.swapaxes(1, 2))
        return own - 2 * cross + np.square(flat).sum(axis=1)[:, None]


def homogeneous(points: np.ndarray) -> np.ndarray:
    """(N, 3) -> (N, 4) with a last column of ones."""
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)


def moved(rest: np.ndarray, weights: np.ndarray, bones: Bones) -> np.ndarray:
    """(N, T, 3) vertices at rest (N, 3) moved by bones blended with weights (N, V): equation 1 of JointNet."""
    flat = np.zeros((len(rest), 3 * bones.rotation.shape[1]))
    points = homogeneous(rest)
    for bone, matrix in enumerate(bones.matrices()):
        rows = np.flatnonzero(weights[:, bone])
        flat[rows] += (weights[rows, bone, None] * points[rows]) @ matrix
    return flat.reshape(len(rest), -1, 3)


def fit_cluster(rest: np.ndarray, moves: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rigid motion (T, 3, 3), (T, 3) nearest to that of the vertices of a mask (N,)."""
    return _rigid(rest[chosen], moves[chosen], np.ones(int(chosen.sum())))


def first_bones(rest: np.ndarray, moves: np.ndarray, weights: np.ndarray) -> Bones:
    """Bones where each is fitted alone to the vertices that it moves, by how much it moves them."""
    fits = []
    for bone in range(weights.shape[1]):
        rows = np.flatnonzero(weights[:, bone])
        own = weights[rows, bone]
        fits.append(_rigid(rest[rows], own[:, None, None] * moves[rows], own))
    return Bones.stack(fits)


def refine_bones(rest: np.ndarray, moves: np.ndarray, weights: np.ndarray, bones: Bones) -> Bones:
    """One bone after the other moved to where it fits best what the others leave; the error never rises."""
    better = Bones(bones.rotation.copy(), bones.translation.copy())
    left = moves - moved(rest, weights, bones)
    points = homogeneous(rest)
    for bone, matrix in enumerate(bones.matrices()):
        rows = np.flatnonzero(weights[:, bone])
        if not len(rows):
            continue
        own = weights[rows, bone]
        weighted = own[:, None] * points[rows]
        target = left[rows] + (weighted @ matrix).reshape(len(rows), -1, 3)
        better.put(bone, _rigid(rest[rows], target, own))
        now = Bones(better.rotation[bone : bone + 1], better.translation[bone : bone + 1]).matrices()[0]
        left[rows] = target - (weighted @ now).reshape(len(rows), -1, 3)
    return better


def _rigid(rest: np.ndarray, targets: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R (T, 3, 3) and T (T, 3) that minimise sum_i |w_i (R u_i + T) - q_i|^2 in each frame.

    Args:
        rest: u, (n, 3). targets: q, (n, T, 3). weights: w, (n,) above 0. Of no vertices the motion is none.
    """
    if not len(rest):
        frames = targets.shape[1]
        return np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))
    squared = weights * weights
    centre = squared @ rest / squared.sum()
    flat = targets.reshape(len(rest), -1)
    mean = (weights @ flat / squared.sum()).reshape(-1, 3)
    covariance = ((weights[:, None] * (rest - centre)).T @ flat).reshape(
        3, -1, 3
    )  # u's axis, frame, q's axis
    rotation = nearest_rotation(covariance.transpose(1, 2, 0))
    return rotation, mean - rotation @ centre
