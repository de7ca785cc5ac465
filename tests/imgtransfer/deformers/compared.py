"""Predictions compared: with the truth, and with those of other frame rates."""

from __future__ import annotations

import numpy as np

from imgtransfer.data.clip import Clip
from tests.helpers.clips import with_arrays


def every_second_frame(clip: Clip) -> Clip:
    """The clip at half its rate."""
    return with_arrays(clip.slice(slice(None, None, 2)), fps=clip.fps / 2)


def mean_distance_mm(predicted: np.ndarray, truth: np.ndarray) -> float:
    """The mean distance of vertices (T, N, 3), metres, in millimetres."""
    return 1e3 * float(np.linalg.norm(predicted - truth, axis=-1).mean())
