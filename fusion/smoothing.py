"""Jitter taken out of fused frames: each vertex's path smoothed over time, without lag."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import ceil, pi, sin

import numpy as np
from scipy.linalg import solveh_banded

from fusion.config import FusionConfig
from fusion.inputs import DecodedMaps, FusionInputs
from fusion.stages import BatchResult
from render.errors import InputError
from render.limits import check_rate

# Periods on either side of a frame beyond which others have no part in it, but for rounding (2e-8 of their motion).
_REACH = 4.0

#: The smoothed vertices (T, N, 3) of a batch of these inputs, put where they may be: outside of the obstacles, pins in
#: place; and the fraction of the vertices inside afterwards (T,), None without obstacle.
Settle = Callable[[FusionInputs, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray | None]]


def smoothed_paths(vertices: np.ndarray, period: float) -> np.ndarray:
    """Paths x of least Σ |x − y|² + κ Σ |second difference of x|² (Whittaker 1923), y being those given.

    A filter without phase: what goes on a straight line at a steady pace stays, at the ends of the clip, too, and an
    oscillation keeps its phase. Its amplitude is multiplied by 1 / (1 + (sin(π f) / sin(π / period))⁴), f being its
    frequency per frame: by 1/2 at the period, by nearly 1 at much longer ones, by nearly 0 at much shorter ones.

    Args:
        vertices: (T, N, 3), consecutive frames; fewer than three stay as they are.
        period: frames, at least 2.

    Returns:
        (T, N, 3) float64.
    """
    frames = len(vertices)
    paths = vertices.reshape(frames, -1).astype(np.float64)
    if frames < 3:
        return paths.reshape(vertices.shape)
    stiffness = (2 * sin(pi / period)) ** -4
    bend = np.array([1.0, -2.0, 1.0])
    bands = np.zeros((3, frames))  # the upper diagonals of 1 + κ DᵀD, the main one last
    bands[2] = 1
    for offset in range(3):
        for first in range(3 - offset):
            columns = slice(first + offset, first + offset + frames - 2)
            bands[2 - offset, columns] += stiffness * bend[first] * bend[first + offset]
    smooth: np.ndarray = solveh_banded(bands, paths, check_finite=False)
    return smooth.reshape(vertices.shape)


def period_in_frames(config: FusionConfig, fps: float | None) -> float:
    """`smooth_time_s` in frames.

    Raises:
        InputError: an unknown rate, or a time of less than two frames, which can hold no oscillation.
    """
    seconds = config.smooth_time_s
    if fps is None:
        raise InputError(
            f"fuse: smooth_time_s is {seconds:g}, but how many frames a second there are is not known; give fps, too"
        )
    check_rate(fps, "fuse")
    if seconds * fps < 2:
        raise InputError(
            f"fuse: smooth_time_s is {seconds:g}, less than two frames at {fps:g} a second, which smooths nothing; "
            f"give at least {ceil(2000 / fps) / 1000:g}, or 0"
        )
    return seconds * fps


class TemporalSmoothing:
    """Smooths frames that come batch by batch, with those in reach on either side in memory.

    Args:
        period: frames, see `smoothed_paths`.
        settle: is given each batch's inputs without maps, its vertices before, and after smoothing.
        rate: frames a second.
    """

    def __init__(self, period: float, settle: Settle, rate: float) -> None:
        self._period, self._settle = period, settle
        self._reach = ceil(_REACH * period)
        self._inputs: deque[FusionInputs] = deque()
        self._accelerations = {"before_smoothing": _Acceleration(rate), "after": _Acceleration(rate)}

    def noting(self, batches: Iterable[FusionInputs]) -> Iterator[FusionInputs]:
        """The batches as they go to the solver; all but their maps is kept until they are smoothed."""
        for batch in batches:
            self._inputs.append(replace(batch, maps=DecodedMaps()))
            yield batch

    def smoothed(self, solved: Iterable[BatchResult]) -> Iterator[BatchResult]:
        """The solved batches in their order, each once the frames in its reach are there."""
        waiting: deque[BatchResult] = deque()
        past: list[np.ndarray] = []  # of vertices, as many as reach back from the first that waits
        for batch in solved:
            waiting.append(batch)
            while sum(len(later.vertices) for later in list(waiting)[1:]) >= self._reach:
                yield self._next(past, waiting)
        while waiting:
            yield self._next(past, waiting)

    def report(self) -> dict[str, dict[str, float]]:
        """Mean acceleration of the vertices before and after, of clips of three frames or more."""
        found = {when: acceleration.mean() for when, acceleration in self._accelerations.items()}
        return {"acceleration_m_s2": found}

    def _next(self, past: list[np.ndarray], waiting: deque[BatchResult]) -> BatchResult:
        """The first batch that waits, smoothed; it belongs to the past then."""
        batch, inputs = waiting.popleft(), self._inputs.popleft()
        before, count = sum(map(len, past)), len(batch.vertices)
        window = np.concatenate([*past, batch.vertices, *(later.vertices for later in waiting)])
        window = window[: before + count + self._reach]
        smooth = smoothed_paths(window, self._period)[before : before + count].astype(np.float32)
        vertices, inside = self._settle(inputs, batch.vertices, smooth)
        past.append(batch.vertices)
        past[:] = [np.concatenate(past)[-self._reach :]]
        self._accelerations["before_smoothing"].add(batch.vertices)
        self._accelerations["after"].add(vertices)
        if batch.inside is not None and inside is not None:
            return replace(batch, vertices=vertices, inside=(batch.inside[0], inside))
        return replace(batch, vertices=vertices)


class _Acceleration:
    """Mean length of the second difference, of frames that come in parts."""

    def __init__(self, rate: float) -> None:
        self._rate, self._sum, self._count = rate, 0.0, 0
        self._last: np.ndarray | None = None

    def add(self, vertices: np.ndarray) -> None:
        some = vertices.astype(np.float64)
        if self._last is not None:
            some = np.concatenate([self._last, some])
        self._last = some[-2:]
        lengths = np.linalg.norm(np.diff(some, n=2, axis=0), axis=-1)
        self._sum += float(lengths.sum()) * self._rate**2
        self._count += lengths.size

    def mean(self) -> float:
        return self._sum / max(self._count, 1)
