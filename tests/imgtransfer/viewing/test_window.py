"""Only the frames that are shown are read, in constant memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.reader import NpzReader
from imgtransfer.data.store import DataSet
from imgtransfer.viewing.clip_motion import ClipMotion
from imgtransfer.viewing.sources import open_sources
from imgtransfer.viewing.window import InOrder, Window, clip_window
from tests.helpers.synthetic import tube_clip


def test_a_window_reads_each_part_once_and_forgets_the_oldest() -> None:
    read: list[int] = []

    def part(number: int) -> str:
        read.append(number)
        return f"part {number}"

    window = Window(10, part)
    assert window(0) == ("part 0", 0)
    assert window(9) == ("part 0", 9)
    assert window(25) == ("part 2", 5)
    assert read == [0, 2]
    for frame in (30, 40, 50):  # with part 2 the four that are kept
        window(frame)
    window(20)
    window(0)
    assert read == [0, 2, 3, 4, 5, 0]


def test_parts_in_order_go_on_where_they_stopped_and_begin_again_for_earlier_ones() -> None:
    begun: list[int] = []

    def parts() -> Iterator[int]:
        begun.append(1)
        yield from range(100)

    of = InOrder(parts)
    assert [of(number) for number in (0, 1, 5, 6)] == [0, 1, 5, 6]
    assert len(begun) == 1
    assert of(3) == 3
    assert of(99) == 99
    assert len(begun) == 2


@pytest.mark.parametrize("order", [[0, 5, 3, 33, 17, 16, 39, 0]])
def test_a_window_gives_the_frames_of_the_clip_from_npz_and_data_set(
    tmp_path: Path, order: list[int]
) -> None:
    clip = tube_clip(40)
    stored = DataSet.create(tmp_path / "data.zarr")
    stored.write("tube/a", clip, split="train")
    with written_clip(tmp_path / "clip.npz") as add:
        add(clip)
    for reader in (stored.reader("tube/a"), NpzReader(tmp_path / "clip.npz")):
        window = clip_window(reader)
        for frame in order:
            part, row = window(frame)
            np.testing.assert_array_equal(part.body.vertices[row], clip.body.vertices[frame])


def ten_thousand(file: Path, clip: Clip) -> None:
    """The clip again and again until there are 10,000 frames."""
    with written_clip(file) as add:
        for _ in range(10_000 // clip.n_frames):
            add(clip)


def check_shown_in_constant_memory(path: Path, clip: Clip) -> None:
    """Open a clip that repeats `clip`, and go through it: in memory is never more than a tenth of it."""
    whole = 10_000 * 12 * (len(clip.template.vertices) + len(clip.body.rest))
    (showing,) = next(iter(open_sources([path]).values()))
    ClipMotion(showing).frame(0)  # imports what it needs
    tracemalloc.start()
    try:
        motion = ClipMotion(showing)
        assert motion.n_frames == 10_000
        for number in (*range(0, 300, 7), 120):
            np.testing.assert_array_equal(
                motion.frame(number).body, clip.body.vertices[number % clip.n_frames]
            )
        assert tracemalloc.get_traced_memory()[1] < whole / 10
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(motion.frame(9_999).body, clip.body.vertices[-1])


def test_ten_thousand_frames_of_an_npz_are_shown_in_constant_memory(tmp_path: Path) -> None:
    clip = tube_clip(1000, rings=4, sides=5)
    ten_thousand(tmp_path / "long.npz", clip)
    check_shown_in_constant_memory(tmp_path / "long.npz", clip)


def test_ten_thousand_frames_of_a_data_set_are_shown_in_constant_memory(tmp_path: Path) -> None:
    clip = tube_clip(1000, rings=4, sides=5)
    ten_thousand(tmp_path / "long.npz", clip)
    whole = NpzReader(tmp_path / "long.npz").clip()
    DataSet.create(tmp_path / "long.zarr").write("tube/long", whole, split="train")
    check_shown_in_constant_memory(tmp_path / "long.zarr", clip)
