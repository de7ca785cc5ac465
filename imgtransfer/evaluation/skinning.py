"""The baseline to beat: the garment skinned with the weights of the nearest body vertices."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.data.clip import Clip
from imgtransfer.data.skinning import joint_transforms, skin
from render import InputError


def lbs_baseline(clip: Clip) -> np.ndarray:
    """The template moved by linear blend skinning, each vertex with its nearest body rest vertex's weights.

    Args:
        clip: with `blend_weights`, and either `joint_transforms` or poses, trans, joints_rest and parents.

    Returns:
        (T, N, 3) float32, world coordinates, metres.

    Raises:
        InputError: the clip has no skinning.
    """
    if clip.skeleton.blend_weights is None:
        raise InputError(f"{clip.name}: no skinning; it lacks blend_weights, so it has no skinned baseline")
    _, nearest = cKDTree(clip.body.rest).query(clip.template.vertices)
    weights = clip.skeleton.blend_weights[nearest]
    return skin(clip.template.vertices, weights, joint_transforms(clip)).astype(np.float32)
