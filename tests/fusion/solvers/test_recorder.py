"""Launches that are made again and again: which memory they work on, and in what order."""

import pytest
import torch

from fusion.solvers.recorder import Recorder, frames_last

FRAMES, COUNT = 2, 3


def recorder(dtype=torch.float64):
    like, busy = torch.zeros(FRAMES, COUNT, 3, dtype=dtype), torch.ones(1, dtype=torch.int32)
    return Recorder(like, busy), busy


def made(dtype=torch.float64, value=0.0):
    """(T, N, 3) as the kernels want it."""
    tensor = frames_last(FRAMES, COUNT, 3, like=torch.zeros(1, dtype=dtype))
    tensor.fill_(value)
    return tensor


def shift(record, source, target, length):
    """A launch of `advance`: target = source + length · (1, 1, 1)."""
    direction, moving = torch.ones(FRAMES, COUNT, 3), torch.ones(FRAMES)
    arguments = [record.frames(tensor) for tensor in (moving, source, direction, length)]
    record("advance", COUNT, *arguments, None, None, None, record.frames(target))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_launches_read_what_tensors_hold_when_they_are_run(dtype):
    record, _ = recorder(dtype)
    source, target = made(dtype), made(dtype)
    length = frames_last(FRAMES, like=source)
    length.fill_(1)
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
    first, second, third = made(), made(), made()
    shift(record, first, second, torch.full((FRAMES,), 2.0))
    shift(record, second, third, torch.full((FRAMES,), 3.0))
    record.run()
    assert third.eq(5).all()


def test_groups_that_are_not_busy_are_left_out():
    record, busy = recorder()
    target = made(value=-1.0)
    shift(record, torch.zeros_like(target), target, torch.ones(FRAMES))
    busy[0] = 0
    record.run()
    assert target.eq(-1).all()
    busy[0] = 1
    record.run()
    assert target.eq(1).all()


def test_no_columns_are_no_launch():
    record, _ = recorder()
    record("advance", 0, *[None] * 8)  # no arguments that Warp would take
    record.run()


def test_what_has_another_dtype_or_layout_is_copied():
    """What is read only may be of any kind; Warp would read it as another without a word."""
    record, _ = recorder()
    source = torch.arange(FRAMES * COUNT * 3).reshape(3, COUNT, FRAMES).transpose(0, 2)  # integers, strided
    target = made()
    shift(record, source, target, torch.tensor([0.5, 0.5]))
    record.run()
    torch.testing.assert_close(target, source.double() + 0.5)


@pytest.mark.parametrize("frames", [1, 8, 11])
def test_frames_lie_side_by_side_in_whole_groups(frames):
    tensor = frames_last(frames, 5, 3, like=torch.zeros(1))
    assert tensor.shape == (frames, 5, 3)
    assert tensor.stride(0) == 1
    assert tensor.stride(2) == 8 * -(-frames // 8)
    assert tensor.eq(0).all()


def test_a_part_of_other_numbers_is_copied_and_not_written_beyond():
    """(T,) in the middle of something longer looks as if made by `frames_last`, but what follows is another's."""
    record, _ = recorder()
    longer = torch.arange(20, dtype=torch.float64)
    record.frames(longer[3 : 3 + FRAMES]).fill_(0)
    assert torch.equal(longer, torch.arange(20, dtype=torch.float64))
