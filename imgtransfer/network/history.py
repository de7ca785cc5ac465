"""Where the body was some time before each frame, whatever the clip's frame rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imgtransfer.data.canonical import RootFrames


def earlier_steps(history_s: Sequence[float], fps: float) -> list[tuple[int, int, float]]:
    """How far back, in frames of a clip, some times lie.

    Args:
        history_s: how long before the frame, seconds.
        fps: of the clip.

    Returns:
        for each time the two frames that it lies between, as steps back, and the weight of the second: (2, 3, 0.25) is
        three quarters of what was two frames ago and a quarter of what was three frames ago.
    """
    steps = []
    for seconds in history_s:
        back = round(seconds * fps, 6)  # 0.1 s at 30 frames a second are three frames, not 3.0000000000000004
        near = int(np.floor(back))
        steps.append((near, near + (back > near), back - near))
    return steps


def mixed(near: np.ndarray, far: np.ndarray, weight: float) -> np.ndarray:
    """`near` and `far` (..., 3) blended linearly, as float32; exactly `near` where `weight` is 0."""
    return near if weight == 0 else ((1 - weight) * near + weight * far).astype(np.float32)


def vertical(frames: RootFrames) -> np.ndarray:
    """(T, 3) float32: the world's y axis as the canonical frames have it."""
    return frames.rotation[:, 1].astype(np.float32)


class History:
    """Carries the body's samples from one part of a clip to the next.

    Args:
        history_s: how long before each frame the body is shown, seconds. fps: of the clip.
    """

    def __init__(self, history_s: Sequence[float], fps: float) -> None:
        self._steps = earlier_steps(history_s, fps)
        self._kept = max((far for _, far, _ in self._steps), default=0)
        self._last: np.ndarray | None = None

    def __call__(self, samples: np.ndarray, frames: RootFrames) -> tuple[np.ndarray, np.ndarray]:
        """(T, J, 3) world -> (T, L - 1, J, 3) of earlier times and (T, 3) the vertical, both in the canonical frames.

        Before the clip's first frame the body stood as it does there.
        """
        before = np.repeat(samples[:1], self._kept, axis=0) if self._last is None else self._last
        whole = np.concatenate([before, samples])
        self._last = whole[len(whole) - self._kept :]
        at = np.arange(len(samples)) + self._kept
        earlier = np.empty((len(samples), len(self._steps), *samples.shape[1:]), np.float32)
        for number, (near, far, weight) in enumerate(self._steps):
            earlier[:, number] = frames.to_canonical(mixed(whole[at - near], whole[at - far], weight))
        return earlier, vertical(frames)
