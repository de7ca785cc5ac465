"""At which times of a scene its frames are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from render.errors import InputError

_EVEN = 0.05  # of a step, by which the times of frames may be rounded
_MOST = 1_000_000  # frames


@dataclass(frozen=True)
class FrameTimes:
    """Frames of a sequence.

    Args:
        seconds: (T,) of each frame. fps: frames a second; None for a single one. note: what was done to get them.
    """

    seconds: np.ndarray
    fps: float | None
    note: str = ""


def frame_times(samples: np.ndarray, rate: float | None, source: str) -> FrameTimes:
    """A frame for each sample where these come evenly; else evenly between the first and the last.

    Args:
        samples: (S,) seconds, rising. rate: frames a second that the file states. source: for messages.

    Raises:
        InputError: times that are not finite, or more frames than anybody has.
    """
    if not np.isfinite(samples).all():
        raise InputError(f"{source}: the times of its samples are not finite; the file is damaged")
    if len(samples) < 2:
        return FrameTimes(samples, None)
    duration = samples[-1] - samples[0]
    step = duration / (len(samples) - 1)
    if (np.abs(samples - samples[0] - step * np.arange(len(samples))) <= _EVEN * step).all():
        return FrameTimes(samples, round(1 / step, 6))
    fps = rate or 1 / float(np.median(np.diff(samples)))
    if not duration * fps < _MOST:
        raise InputError(
            f"{source}: {duration:g} seconds at {fps:g} frames a second; the file's times make no sense"
        )
    seconds = samples[0] + np.arange(int(duration * fps + 1e-6) + 1) / fps
    note = (
        f"{source}: {len(samples)} samples at uneven times, resampled on straight lines to {len(seconds)} frames, "
        f"{fps:g} a second"
    )
    return FrameTimes(np.minimum(seconds, samples[-1]), round(fps, 6), note)
