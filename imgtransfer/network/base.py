"""The first guess that a residual network corrects: the posed body's images, moved out to the garment.

Garment and body share the cameras, so under nearly every garment pixel lies a body pixel. Its motion, and
that of the template's offset from it, is where the cloth would be if it were glued to the body. No skinning
weights are used: how the surface turns is read off the body's images.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from imgtransfer.network.local_frames import LocalFrames, chosen, window
from render import InputError

SPREAD = 7  # samples along each side of the window that smooths the extension
FrameMode = Literal["canonical", "body"]


@dataclass(frozen=True)
class Guess:
    """A first guess for a batch of frames.

    Args:
        positions: (B, S, H, W, 3) float32, metres, canonical frame; 0 off the silhouette.
        normals: (B, S, H, W, 3) float32, about unit length; 0 off the silhouette.
        rotation: (B, S, H, W, 3, 3) float32, rest to posed, or None where the axes stay the canonical
            frame's.
    """

    positions: Tensor
    normals: Tensor
    rotation: Tensor | None

    def turn(self, residual: Tensor) -> Tensor:
        """(B, S, H, W, 3) in the guess's axes -> the same in the canonical frame's."""
        if self.rotation is None:
            return residual
        return apply(self.rotation, residual)


class BodyGuess:
    """Everything about the first guess that is constant for a template and a rest body, in one shape or several.

    A pixel shows the same point of garment and body in every shape: that which it shows of the shape that is projected.

    Args:
        mask: (S, H, W) bool, the garment's silhouette.
        template_positions: (K, S, H, W, 3) float32, metres, the template in K shapes.
        template_normals: (K, S, H, W, 3) float32, unit.
        body_mask: (S, H, W) bool, the body's silhouette by the same cameras.
        projected: (S, H, W, 3) float32, metres, the rest body in the shape that is projected.
        rest_positions: (K, S, H, W, 3) float32, metres, the rest body in K shapes.
        rest_normals: (K, S, H, W, 3) float32, unit.
        frame: "canonical" keeps the axes of offset and residual, "body" turns them with the surface below.

    Raises:
        InputError: a view in which the body covers no pixel.
    """

    def __init__(
        self,
        *,
        mask: Tensor,
        template_positions: Tensor,
        template_normals: Tensor,
        body_mask: Tensor,
        projected: Tensor,
        rest_positions: Tensor,
        rest_normals: Tensor,
        frame: FrameMode,
    ) -> None:
        self.mask = mask
        pixels, index, weight = _extension(mask.cpu().numpy(), body_mask.cpu().numpy())
        self._pixels = torch.from_numpy(pixels).to(mask.device)
        self._index = torch.from_numpy(index).to(mask.device)
        self._weight = torch.from_numpy(weight).to(template_positions)
        self._offset = (template_positions - self.extend(rest_positions)) * mask[..., None]
        self._normals = template_normals
        self._rest_normals = rest_normals
        self._frames: LocalFrames | None = None
        if frame == "body":
            self._frames = LocalFrames(body_mask, projected, rest_positions, rest_normals)

    def extend(self, body: Tensor) -> Tensor:
        """(..., S, H, W, C) body images -> extended smoothly over the garment's silhouette, 0 elsewhere.

        Where the body covers the pixel its own value stands; elsewhere a mean of the nearest covered pixels'
        values over a window that grows with the distance to the body, so that the extension has no seams.
        """
        flat = body.flatten(-4, -2) * self.mask.flatten()[:, None]
        nearest = body.flatten(-4, -2)[..., self._index, :]  # (..., P, SPREAD ** 2, C)
        flat[..., self._pixels, :] = (nearest * self._weight[..., None]).sum(-2)
        return flat.unflatten(-2, self.mask.shape)

    def __call__(self, positions: Tensor, normals: Tensor, shape: Tensor | None = None) -> Guess:
        """The guess for posed bodies.

        Args:
            positions: (B, S, H, W, 3) float32, metres, body images decoded, canonical frame.
            normals: (B, S, H, W, 3) float32, unit, body images decoded.
            shape: (B,) int64, which of the K shapes each is; the first if None.
        """
        moved = self.extend(positions)
        offset, template_normals = chosen(self._offset, shape), chosen(self._normals, shape)
        if self._frames is None:
            turned = template_normals + self.extend(normals - chosen(self._rest_normals, shape))
            return Guess(moved + offset, turned, None)
        rotation = self._frames(positions, normals, shape)
        return Guess(moved + apply(rotation, offset), apply(rotation, template_normals), rotation)


def apply(rotation: Tensor, vectors: Tensor) -> Tensor:
    """(..., 3, 3) times (..., 3). Not a matrix product, which autocast would round to bfloat16.

    Column by column: summing over an axis of three takes four times as long.
    """
    first, second, third = (rotation[..., axis] * vectors[..., axis, None] for axis in range(3))
    return first + second + third


def _extension(mask: np.ndarray, body_mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which body pixels stand for the garment pixels that the body does not cover.

    Args:
        mask: (S, H, W) bool, the garment's silhouette.
        body_mask: (S, H, W) bool, the body's.

    Returns:
        pixels (P,) flat indices of the garment's uncovered pixels; index (P, SPREAD²) int64 flat indices of
        covered body pixels; weight (P, SPREAD²) float32, sums to 1.
    """
    views, height, width = mask.shape
    pixels, indices, weights = [], [], []
    for view in range(views):
        if not body_mask[view].any():
            raise InputError(f"the body covers no pixel of view {view}; do garment and body share one frame?")
        distance, nearest = ndimage.distance_transform_edt(~body_mask[view], return_indices=True)
        row, column = np.nonzero(mask[view] & ~body_mask[view])
        sigma = distance[row, column] / 2
        at_row, at_column, steps = window(row, column, reach=2 * sigma, samples=SPREAD, size=(height, width))
        weight = np.exp(-2 * steps.sum(-1)) * np.ones((len(row), 1))
        start = view * height * width
        pixels.append(start + row * width + column)
        indices.append(start + nearest[0][at_row, at_column] * width + nearest[1][at_row, at_column])
        weights.append(weight / weight.sum(1, keepdims=True))
    return np.concatenate(pixels), np.concatenate(indices), np.concatenate(weights).astype(np.float32)
