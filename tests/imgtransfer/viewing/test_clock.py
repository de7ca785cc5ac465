"""Frames by the time that has passed."""

from __future__ import annotations

import pytest

from imgtransfer.viewing.clock import Clock


class Time:
    """Seconds that pass only where a test says so."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_clip_plays_from_the_frame_it_stands_at_and_begins_again() -> None:
    time = Time()
    clock = Clock(time)
    clock.start(10, 5.0)
    time.now += 3
    assert clock.frame() == 0  # not yet playing
    clock.go_to(4)
    clock.set(True, 5.0)
    time.now += 0.5
    assert clock.frame() == 6
    assert clock.until_next() == pytest.approx(0.1, abs=1e-6)
    time.now += 1.0  # 11.5 frames from the first on
    assert clock.frame() == 1
    clock.set(False, 5.0)
    time.now += 10
    assert clock.frame() == 1


def test_another_rate_counts_from_now_on() -> None:
    time = Time()
    clock = Clock(time)
    clock.start(100, 10.0)
    clock.set(True, 10.0)
    time.now += 1
    clock.set(True, 1.0)
    time.now += 2
    assert clock.frame() == 12


def test_steps_go_round_at_both_ends() -> None:
    clock = Clock(Time())
    clock.start(3, 1.0)
    clock.go_to(-1)
    assert clock.frame() == 2
    clock.go_to(3)
    assert clock.frame() == 0
