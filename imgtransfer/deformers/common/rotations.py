"""Rotations as networks read and write them."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

_TINY = 1e-8  # of an angle squared, where sin(x) / x is its series


def six_numbers(rotation_vectors: np.ndarray) -> np.ndarray:
    """Axis-angle (..., 3), radians -> (..., 6) float32: the first two columns of the matrix, without jumps anywhere."""
    turns = Rotation.from_rotvec(rotation_vectors.reshape(-1, 3).astype(np.float64)).as_matrix()
    columns = turns[:, :, :2].swapaxes(1, 2).reshape(*rotation_vectors.shape[:-1], 6)
    return columns.astype(np.float32)


def rotation_matrices(rotation_vectors: Tensor) -> Tensor:
    """Axis-angle (..., 3), radians -> (..., 3, 3) by Rodrigues' formula, with a gradient at 0, too."""
    squared = rotation_vectors.square().sum(-1)[..., None, None]
    tiny = squared < _TINY
    angle = torch.where(tiny, torch.ones_like(squared), squared).sqrt()
    sine = torch.where(tiny, 1 - squared / 6, angle.sin() / angle)
    cosine = torch.where(tiny, 0.5 - squared / 24, (1 - angle.cos()) / angle.square())
    x, y, z = rotation_vectors.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    return torch.eye(3, dtype=cross.dtype, device=cross.device) + sine * cross + cosine * cross @ cross


def mean_rotation(rotations: np.ndarray) -> np.ndarray:
    """(T, ..., 3, 3) -> (..., 3, 3), the rotation nearest to the mean of the matrices."""
    return nearest_rotation(rotations.mean(axis=0))


def nearest_rotation(matrices: np.ndarray) -> np.ndarray:
    """(..., 3, 3) -> the rotation R of greatest trace of Rᵀ times the matrix: Kabsch's fit for M = Σ q pᵀ, q = R p."""
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right
