"""How far off the skin cloth rests: what a simulator's contact offset, or half of two thicknesses, leaves in clips."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.data.clip import Clip
from render import InputError

FRAMES = 64  # of all clips together that are looked at, about, evenly spread
# Percent of a frame's vertices nearest to the skin: these rest on it, in garments of four kinds by two simulators, and
# single ones that are squeezed between two limbs do not count.
_NEAREST = 5.0
_RESTS_WITHIN = 0.02  # metres; a garment that comes no nearer rests on nothing, and says nothing of it

#: Garment (T, N, 3) and body (T, V, 3) of some frames, metres in one frame of coordinates, and the body's faces (G, 3).
Worn = tuple[np.ndarray, np.ndarray, np.ndarray]


def contact_offset(worn: Iterable[Worn]) -> float | None:
    """Metres off the skin at which cloth rests where it touches.

    The distance that a twentieth of a frame's vertices are below, and of these the median over all frames; 0 where the
    cloth lies in the body, None where it comes no nearer than 2 cm. Bodies turned inside out do not count.
    """
    nearest: list[float] = []
    for garment, body, faces in worn:
        sdf = BodySdf(faces, body.shape[1])
        try:
            sdf.update(body)
        except InputError:  # turned inside out: it tells nothing, and whoever needs its distances refuses it
            continue
        points = torch.from_numpy(np.ascontiguousarray(garment, np.float32))
        distances = sdf.query(points).distance.numpy().astype(np.float64)
        nearest.extend(np.percentile(distances, _NEAREST, axis=1))
    median = float(np.median(nearest)) if nearest else np.inf
    return max(median, 0.0) if median < _RESTS_WITHIN else None


def of_clips(clips: Iterable[Clip]) -> float | None:
    """`contact_offset` of some frames of each clip; those without a garment's motion are left out."""
    moving = [clip for clip in clips if clip.garment is not None]
    each = -(-FRAMES // max(len(moving), 1))

    def worn() -> Iterable[Worn]:
        for clip in moving:
            chosen = np.unique(np.linspace(0, clip.n_frames - 1, each).round().astype(int))
            assert clip.garment is not None
            yield clip.garment.vertices[chosen], clip.body.vertices[chosen], clip.body.faces

    return contact_offset(worn())
