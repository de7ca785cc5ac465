"""Intervals by hand."""

from __future__ import annotations

import numpy as np
import pytest

from imgtransfer.benchmark.statistics import bootstrap_intervals
from imgtransfer.evaluation.metrics import METRICS


def metrics(value: float) -> dict[str, float]:
    return dict.fromkeys(METRICS, value)


def test_two_clips_are_drawn_together_or_one_twice() -> None:
    """Half of the draws have both, a quarter either of them twice: 95 % reach to both ends."""
    clips, frames = {"a": metrics(1.0), "b": metrics(4.0)}, {"a": 10, "b": 30}
    low, high = bootstrap_intervals(clips, frames, resamples=1000, seed=0)["rmse_mm"]
    assert (low, high) == (1.0, 4.0)


def test_many_clips_have_the_interval_of_their_mean() -> None:
    values = np.random.default_rng(0).normal(10, 2, 100)
    clips = {f"{n:03}": metrics(value) for n, value in enumerate(values)}
    low, high = bootstrap_intervals(clips, dict.fromkeys(clips, 7), resamples=4000, seed=1)["sted"]
    reach = 1.96 * values.std() / np.sqrt(len(values))
    assert low == pytest.approx(values.mean() - reach, abs=0.06)
    assert high == pytest.approx(values.mean() + reach, abs=0.06)


def test_a_single_clip_has_none() -> None:
    assert bootstrap_intervals({"a": metrics(1.0)}, {"a": 3}, resamples=100, seed=0) is None
