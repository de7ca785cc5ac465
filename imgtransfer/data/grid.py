"""A grid of 2⁻¹⁶ m for positions: values on it are whole numbers, whose differences in time pack well.

On a simulated T-shirt of 4,424 vertices the differences take 33 % of the float32 array after compression,
float32 values on the grid 49 %, and values off the grid 78 %. A step is 15 µm, far below what a cloth
simulator repeats.
"""

from __future__ import annotations

import numpy as np

STEP = 2.0**-16  # metres
_LIMIT = (
    2**28
)  # steps (4,096 m): second differences of such numbers, at most four times as large, fit into int32


def round_to_grid(points: np.ndarray) -> np.ndarray:
    """(...) metres -> the nearest multiples of 2⁻¹⁶ m, float32; beyond 256 m float32 itself is coarser."""
    steps = np.rint(np.asarray(points, np.float64) / STEP) + 0.0  # -0.0 + 0.0 is 0.0
    return (steps * STEP).astype(np.float32)


def lies_on_grid(points: np.ndarray) -> bool:
    """Whether `points` are float32, all multiples of the step, and small enough for `to_differences`."""
    if points.dtype != np.float32:
        return False
    steps = points.astype(np.float64) / STEP
    return bool(
        np.all(np.abs(steps) < _LIMIT)
        and np.all(steps == np.rint(steps))
        and not np.any(np.signbit(points) & (points == 0))
    )


def to_differences(points: np.ndarray) -> np.ndarray:
    """(T, ...) float32 on the grid -> (T, ...) int32: second differences along the first axis, in steps."""
    steps = np.rint(points.astype(np.float64) / STEP).astype(np.int64)
    for _ in range(2):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    return steps.astype(np.int32)


def from_differences(differences: np.ndarray, step: float) -> np.ndarray:
    """The inverse of `to_differences`: (T, ...) int32 -> (T, ...) float32 metres, exact."""
    # The sums fit into int32 in the end, so it does not matter if they wrap on the way; and they are float32
    # numbers of steps, because the positions were.
    steps = differences.cumsum(axis=0, dtype=np.int32)
    np.cumsum(steps, axis=0, out=steps)
    return steps.astype(np.float32) * np.float32(step)
