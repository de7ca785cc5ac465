from __future__ import annotations

import pytest

from imgtransfer.training.remaining import Remaining, duration


def test_the_time_left_is_told_once_from_steps_after_the_warm_up() -> None:
    told: list[float] = []
    now = 0.0
    remaining = Remaining(100, told.append, clock=lambda: now)
    for seconds in (9.0, 9.0, 9.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0):
        now += seconds
        remaining.step()
    assert told == [(100 - 7) * 2.0]


def test_a_run_that_is_over_before_tells_nothing() -> None:
    told: list[float] = []
    remaining = Remaining(7, told.append)
    for _ in range(7):
        remaining.step()
    assert told == []


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (3, "10 seconds"),
        (44, "40 seconds"),
        (70, "a minute"),
        (290, "5 minutes"),
        (4000, "67 minutes"),
        (9000, "2 hours"),
    ],
)
def test_durations_are_said_roughly(seconds: float, text: str) -> None:
    assert duration(seconds) == text
