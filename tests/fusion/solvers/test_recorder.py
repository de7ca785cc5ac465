"""Launches that are made again and again: which memory they work on, and in what order."""

import pytest
import torch

from fusion.solvers.recorder import Recorder

FRAMES, COUNT = 2, 3


def recorder(dtype=torch.float64):
    like = torch.zeros(FRAMES, COUNT, 3, dtype=dtype)
    active = torch.ones(FRAMES, dtype=torch.int32)
    return Recorder(like, active), active


def shift(record, source, target, length):
    """A launch of `advance`: target = source + length · (1, 1, 1)."""
    direction = torch.ones(FRAMES, COUNT, 3).to(target)
    arguments = record.vectors(source), record.vectors(direction), record.reals(length), None, None, None
    record("advance", COUNT, *arguments, record.vectors(target))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_launches_read_what_tensors_hold_when_they_are_run(dtype):
    record, _ = recorder(dtype)
    source, target = (torch.zeros(FRAMES, COUNT, 3, dtype=dtype) for _ in range(2))
    length = torch.ones(FRAMES, dtype=dtype)
    shift(record, source, target, length)
    assert target.eq(0).all()  # recorded, not run
    for start, step in ((0.0, 1.0), (5.0, 0.25)):
        source.fill_(start)
        length.fill_(step)
        record.run()
        assert target.eq(start + step).all()


def test_launches_run_in_their_order():
    """The second goes on from what the first made; the other way round it would end at 3."""
    record, _ = recorder()
    first, second, third = (torch.zeros(FRAMES, COUNT, 3, dtype=torch.float64) for _ in range(3))
    shift(record, first, second, torch.full((FRAMES,), 2.0))
    shift(record, second, third, torch.full((FRAMES,), 3.0))
    record.run()
    assert third.eq(5).all()


def test_frames_that_are_not_active_are_left_out():
    record, active = recorder()
    target = torch.full((FRAMES, COUNT, 3), -1.0, dtype=torch.float64)
    shift(record, torch.zeros_like(target), target, torch.ones(FRAMES))
    active[0] = 0
    record.run()
    assert target[0].eq(-1).all()
    assert target[1].eq(1).all()


def test_no_columns_are_no_launch():
    record, _ = recorder()
    record("advance", 0, *[None] * 7)  # no arguments that Warp would take
    record.run()


def test_what_has_another_dtype_or_layout_is_copied():
    """What is read only may be of any kind; Warp would read it as another without a word."""
    record, _ = recorder()
    source = torch.arange(FRAMES * COUNT * 3).reshape(3, COUNT, FRAMES).transpose(0, 2)  # integers, strided
    target = torch.zeros(FRAMES, COUNT, 3, dtype=torch.float64)
    shift(record, source, target, torch.tensor([0.5, 0.5]))
    record.run()
    torch.testing.assert_close(target, source.double() + 0.5)
