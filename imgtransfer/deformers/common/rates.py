"""Other frame rates than the training's: motions go in at its rate, vertices come back at the clip's."""

from __future__ import annotations

import math

import numpy as np

from imgtransfer.motions.motion import MOST_FRAMES
from render import InputError


def same_rate(a: float, b: float) -> bool:
    """Whether two rates, frames a second, are one but for rounding."""
    return abs(a - b) <= 1e-6 * max(a, b)


def sample_times(n_frames: int, fps: float, wanted: float) -> np.ndarray:
    """Times, seconds, at which a clip of T frames is looked at for another rate; the last is that of its last frame.

    Raises:
        InputError: more frames than anybody means.
    """
    end = (n_frames - 1) / fps
    if end * wanted > MOST_FRAMES:
        raise InputError(
            f"fps: {n_frames} frames at {fps:g} a second are {end:.3g} s long, more than {MOST_FRAMES} frames at the "
            f"{wanted:g} a second that the method was fitted to; is the clip's frame rate right?"
        )
    # Half a millionth of a frame of tolerance, so that rounding does not add a frame.
    return np.minimum(np.arange(math.ceil(end * wanted - 1e-6) + 1) / wanted, end)


def between(position: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (M,) on frames 0 to `count` - 1 -> the frame before each, int, and the part towards the next."""
    before = np.clip(np.floor(position + 1e-9).astype(np.int64), 0, max(count - 2, 0))
    return before, np.clip(position - before, 0, 1) if count > 1 else np.zeros(len(position))


def at_samples(values: np.ndarray, fps: float, wanted: float) -> np.ndarray:
    """Values (T, ...) at a clip's frames, linearly to (M, ...) at its `sample_times`."""
    before, part = between(sample_times(len(values), fps, wanted) * fps, len(values))
    after = np.minimum(before + 1, len(values) - 1)
    part = part.reshape(-1, *[1] * (values.ndim - 1)).astype(values.dtype)
    return values[before] + part * (values[after] - values[before])


def at_frames(values: np.ndarray, n_frames: int, fps: float, sampled: float) -> np.ndarray:
    """Values (M, ...) at the `sample_times` of a clip, linearly to (T, ...) at its frames.

    Args:
        n_frames, fps: the clip's.
        sampled: the rate of `values`.
    """
    nodes = sample_times(n_frames, fps, sampled)
    times = np.arange(n_frames) / fps
    before = np.clip(np.searchsorted(nodes, times + 1e-9) - 1, 0, max(len(nodes) - 2, 0))
    after = np.minimum(before + 1, len(nodes) - 1)
    length = nodes[after] - nodes[before]
    part = np.where(length > 0, (times - nodes[before]) / np.where(length > 0, length, 1), 0).clip(0, 1)
    part = part.reshape(-1, *[1] * (values.ndim - 1)).astype(values.dtype)
    return values[before] + part * (values[after] - values[before])
