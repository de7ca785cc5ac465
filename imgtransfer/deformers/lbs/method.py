"""The deformer `lbs`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from imgtransfer.config.schema import Metres, Section
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder, same_garment
from imgtransfer.deformers.lbs.skinned import SkinnedGarment, posed
from imgtransfer.deformers.lbs.weights import garment_weights


class LbsConfig(Section):
    """Linear blend skinning: weights of the nearest body vertices at rest, diffused over the garment."""

    neighbours: int = Field(
        8, ge=1, le=1000, description="Body vertices that a garment vertex takes its weights from."
    )
    diffusion: Metres = Field(
        0.02, ge=0, le=10, description="How far weights then spread over the cloth; 0 leaves them."
    )


class Lbs(Deformer):
    """The garment skinned to its body; of the training clips it only needs the template and the body at rest."""

    name: ClassVar[str] = "lbs"
    Config = LbsConfig
    garment: SkinnedGarment

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        self.garment = skinned(same_garment(clips), self.config)

    def predict(self, clip: Clip) -> np.ndarray:
        return posed(self.garment.blended(clip), clip.template.vertices).astype(np.float32)

    def tensors(self) -> dict[str, Tensor]:
        return skinned_tensors(self.garment)

    def restore(self, tensors: dict[str, Tensor]) -> None:
        self.garment = skinned_of(tensors)


def skinned(clip: Clip, config: Section) -> SkinnedGarment:
    """The garment of a clip with its weights.

    Args:
        config: with the settings of `LbsConfig`.
    """
    assert isinstance(config, LbsConfig)
    weights = garment_weights(clip, neighbours=config.neighbours, diffusion=config.diffusion)
    return SkinnedGarment(clip.template.faces, weights)


def skinned_tensors(garment: SkinnedGarment) -> dict[str, Tensor]:
    """Faces and weights by name, for a file."""
    return {
        "faces": torch.from_numpy(garment.faces.astype(np.int64)),
        "weights": torch.from_numpy(garment.weights),
    }


def skinned_of(tensors: dict[str, Tensor]) -> SkinnedGarment:
    """The inverse of `skinned_tensors`.

    Raises:
        ValueError: tensors that are missing, of other types or shapes, or faces of vertices that are not there.
    """
    faces, weights = tensors.get("faces"), tensors.get("weights")
    if faces is None or weights is None or faces.ndim != 2 or weights.ndim != 2 or faces.shape[1] != 3:
        raise ValueError("faces (F, 3) and weights (N, K) are wanted")
    if faces.dtype != torch.int64 or weights.dtype != torch.float64:
        raise ValueError(f"faces are {faces.dtype} and weights {weights.dtype}, int64 and float64 are wanted")
    if faces.numel() and not 0 <= int(faces.min()) <= int(faces.max()) < len(weights):
        raise ValueError("faces have vertices that have no weights")
    return SkinnedGarment(faces.numpy(), weights.numpy())
