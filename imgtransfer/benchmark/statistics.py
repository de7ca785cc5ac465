"""Means over clips and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from imgtransfer.evaluation.metrics import METRICS


def bootstrap_intervals(
    clips: Mapping[str, Mapping[str, float]], frames: Mapping[str, int], *, resamples: int, seed: int
) -> dict[str, tuple[float, float]] | None:
    """Intervals that hold 95 % of the means over clips that are drawn again, with replacement.

    Frames of one clip are alike, so whole clips are drawn; a mean weighs each by its frames, as `mean_over_frames`.

    Args:
        clips: metrics by clip. frames: of each clip.
        resamples: how many draws. seed: of them; the same draws for every method of one benchmark.

    Returns:
        By metric the 2.5th and 97.5th percentile; None for a single clip, of which nothing is known.
    """
    if len(clips) < 2:
        return None
    generator = np.random.default_rng(seed)
    names = sorted(clips)
    drawn = generator.integers(0, len(names), (resamples, len(names)))
    weights = np.array([frames[name] for name in names], np.float64)[drawn]
    intervals = {}
    for metric in METRICS:
        values = np.array([clips[name][metric] for name in names])[drawn]
        means = (values * weights).sum(1) / weights.sum(1)
        low, high = np.percentile(means, (2.5, 97.5))
        intervals[metric] = (float(low), float(high))
    return intervals
