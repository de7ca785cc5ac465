"""What a model gives for a clip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from imgtransfer.data.canonical import RootFrames
from render import PositionBox, TemplateImager


@dataclass(frozen=True, eq=False)
class ShownFrames:
    """What the maps of B frames follow from.

    Args:
        frames: the canonical frames.
        fps: frames a second.
        body: (B, V, 3) float32, metres, canonical frame.
        earlier, up, skinned: as `BodyImager.__call__` takes them.
    """

    frames: RootFrames
    fps: float
    body: Tensor
    earlier: Tensor | None = None
    up: Tensor | None = None
    skinned: Tensor | None = None


@dataclass(frozen=True, eq=False)
class Prediction:
    """The maps of one clip, predicted.

    Args:
        positions: (T, S, H, W, 3) float32, encoded by `box`; background 0.
        normals: (T, S, H, W, 3) float32, encoded, of unit length where covered; background 0.
        frames: the canonical frames that the maps are in.
        imager: of the garment's template.
        box: of the positions.
        fps: frames a second.
        rest_vertices: (N, 3) float64, metres, the clip's own template where that is another shape than the imager's.
        contact_offset_m: metres off the skin at which the cloth of the model's training clips rests; None: unknown.
    """

    positions: Tensor
    normals: Tensor
    frames: RootFrames
    imager: TemplateImager
    box: PositionBox
    fps: float
    rest_vertices: np.ndarray | None = None
    contact_offset_m: float | None = None

    def metres(self) -> Tensor:
        """(T, S, H, W, 3) float32, decoded positions, canonical frame; background 0."""
        return self.box.decode(self.positions) * self.imager.mask[..., None]
