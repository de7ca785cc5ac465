"""Pictures of validation frames: predicted and true normals, and how far the positions are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from imgtransfer.training.validation import FrameImages
from render import contact_sheet, decode_normals, encode_normals
from render.pictures import heat_colours

LIMIT_MM = 40.0  # of the brightest colour, the same at all steps


def predicted_sheet(frames: Sequence[FrameImages], labels: Sequence[str]) -> np.ndarray:
    """Predicted normals of frames, and beside them the distance of the positions to the truth, in the first view.

    Args:
        frames: T of them. labels: T texts.

    Returns:
        (H', W', 3) uint8, RGB.
    """
    rows = [[_normals(one, one.predicted.normals, 0), _distance(one, 0)] for one in frames]
    return contact_sheet(rows, row_labels=list(labels))


def true_sheet(frames: Sequence[FrameImages], labels: Sequence[str]) -> np.ndarray:
    """True normals of frames in the first view, as `predicted_sheet` has them."""
    return contact_sheet([[_normals(one, one.truth.normals, 0)] for one in frames], row_labels=list(labels))


def frame_sheet(frame: FrameImages) -> np.ndarray:
    """One frame in all views, a row each: predicted and true normals, distance of the positions."""
    views = [camera.name for camera in frame.model.imager.cameras]
    rows = [
        [
            _normals(frame, frame.predicted.normals, s),
            _normals(frame, frame.truth.normals, s),
            _distance(frame, s),
        ]
        for s in range(len(views))
    ]
    return contact_sheet(
        rows, row_labels=views, column_labels=["predicted", "true", f"0 to {LIMIT_MM:.0f} mm"]
    )


def _normals(frame: FrameImages, normals: Tensor, view: int) -> np.ndarray:
    """(H, W, 3) float, white off the silhouette."""
    unit = encode_normals(functional.normalize(decode_normals(normals[0, view].float()), dim=-1))
    mask = frame.model.mask[view, ..., None]
    return torch.where(mask, unit, torch.ones_like(unit)).cpu().numpy()


def _distance(frame: FrameImages, view: int) -> np.ndarray:
    """(H, W, 3) uint8, white off the silhouette."""
    box = frame.model.box
    metres = [box.decode(pair.positions[0, view].float()) for pair in (frame.predicted, frame.truth)]
    distance = (metres[0] - metres[1]).norm(dim=-1).cpu().numpy() * 1000
    picture = heat_colours(distance / LIMIT_MM)
    picture[~frame.model.mask[view].cpu().numpy()] = 255
    return picture
