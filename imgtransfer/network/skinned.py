"""The garment moved by linear blend skinning, for the variants of the paper that rely on it (section 4.5, table 3)."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from imgtransfer.data.skinning import joint_transforms
from imgtransfer.network.config import NetworkConfig
from render import InputError

CHANNELS = 12  # of a vertex: where it goes, and how what is attached to it turns


def skinned_garment(clip: Clip, frames: RootFrames) -> np.ndarray:
    """The template of a clip, each vertex with the weights of the nearest vertex of the rest body.

    Args:
        clip: with `blend_weights`, and either `joint_transforms` or poses, trans, joints_rest and parents.
        frames: the clip's canonical frames.

    Returns:
        (T, N, 12) float32, canonical frame: the vertices (3), metres, and the linear part of what moves each (3 x 3,
        row by row), the mean of rotations and none itself.

    Raises:
        InputError: the clip has no skinning.
    """
    if clip.skeleton.blend_weights is None:
        raise InputError(
            f"{clip.name}: no skinning; it lacks blend_weights, which network.guess and network.garment: skinned need"
        )
    _, nearest = cKDTree(clip.body.rest).query(clip.template.vertices)
    weights = clip.skeleton.blend_weights[nearest].astype(np.float64)
    rest = clip.template.vertices.astype(np.float64)
    moved = np.empty((clip.n_frames, len(rest), CHANNELS), np.float32)
    for frame, transforms in enumerate(joint_transforms(clip)):
        blended = (weights @ transforms.reshape(len(transforms), 12)).reshape(-1, 3, 4)
        back = frames.rotation[frame].T
        world = np.einsum("nab,nb->na", blended[..., :3], rest) + blended[..., 3]
        moved[frame, :, :3] = (world - frames.translation[frame]) @ back.T
        moved[frame, :, 3:] = (back @ blended[..., :3]).reshape(-1, 9)
    return moved


def skinned_frames(
    clip: Clip, frames: RootFrames, config: NetworkConfig, device: torch.device
) -> Tensor | None:
    """`skinned_garment` as a tensor, where the networks need it."""
    return torch.from_numpy(skinned_garment(clip, frames)).to(device) if config.skins else None
