"""Whether a clip's garment is on its body."""

from __future__ import annotations

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.data.clip import Clip
from render import InputError


def check_worn(clip: Clip, source: str, *, hint: str) -> None:
    """Check that the garment is on the body in the first, middle and last frame.

    Args:
        source: what the message calls the clip. hint: what the user may look at.

    Raises:
        InputError: it is beside the body, or most of it inside.
    """
    if clip.garment is None:
        return
    sdf = BodySdf(clip.body.faces, len(clip.body.rest))
    cloth = np.unique(clip.template.faces)
    for frame in sorted({0, clip.n_frames // 2, clip.n_frames - 1}):
        sdf.update(clip.body.vertices[frame])
        distance = sdf.distance(torch.from_numpy(clip.garment.vertices[frame, cloth])).numpy()
        inside, apart = float((distance < -0.001).mean()), float(np.median(distance))
        if inside > 0.5 or apart > 0.4:
            what = (
                f"{100 * inside:.0f} % of it inside"
                if inside > 0.5
                else f"half of it more than {apart:.2f} m away"
            )
            raise InputError(f"{source}: the garment is not on the body in frame {frame}, {what}; {hint}")
