"""A garment with skinning weights: posed, and displacements from its pose taken back to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import check_faces
from imgtransfer.deformers.lbs.weights import body_skinning
from render import InputError


@dataclass(frozen=True, eq=False)
class SkinnedGarment:
    """A garment's weights, x' = Σ_k w_k T_k x for each vertex x.

    Args:
        faces: (F, 3), by which the garment is known again.
        weights: (N, K) float64, of the columns of the body's weights; rows sum to 1.
    """

    faces: np.ndarray
    weights: np.ndarray

    def blended(self, clip: Clip) -> np.ndarray:
        """Σ_k w_k T_k of every frame and vertex of a clip, (T, N, 3, 4) float64.

        Raises:
            InputError: another garment, no skinning, or a skeleton of another number of columns.
        """
        check_faces(clip, self.faces)
        _, transforms = body_skinning(clip)
        columns = self.weights.shape[1]
        if transforms.shape[1] != columns:
            raise InputError(
                f"{clip.name}: blend_weights have {transforms.shape[1]} columns, and the method was fitted to a body "
                f"with {columns}; clips of one skeleton are wanted"
            )
        flat = transforms.reshape(len(transforms), columns, 12)
        return np.matmul(self.weights, flat).reshape(len(flat), -1, 3, 4)


def posed(blended: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Rest vertices (N, 3) or (T, N, 3), metres, by `SkinnedGarment.blended`: (T, N, 3) float64, world."""
    points = np.broadcast_to(rest.astype(np.float64), blended.shape[:-1])
    return np.matmul(blended[..., :3], points[..., None])[..., 0] + blended[..., 3]


def turns(blended: np.ndarray) -> np.ndarray:
    """The rotation that is nearest to each of `SkinnedGarment.blended`, (T, N, 3, 3) float64."""
    left, _, right = np.linalg.svd(blended[..., :3])
    sign = np.sign(np.linalg.det(left @ right))
    left[..., 2] *= sign[..., None]  # a mean of opposite turns may mirror
    return left @ right
