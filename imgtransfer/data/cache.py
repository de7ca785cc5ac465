"""Frames of many clips by one running number, read in chunks, of which the last used are kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.reader import Reader

Arrays = tuple[np.ndarray, ...]


class FrameCache:
    """Arrays made from clips' frames, numbered through all clips.

    Args:
        readers: the clips.
        make: a clip with some frames -> arrays whose first axis is those frames; called with whole chunks.
        limit: bytes of made arrays to keep; the chunk asked for last is kept in any case.
    """

    def __init__(self, readers: Sequence[Reader], make: Callable[[Clip], Arrays], limit: int) -> None:
        self._readers, self._make, self._limit = readers, make, limit
        self.chunks: list[tuple[int, int, int]] = [  # reader, first frame, last frame + 1, of each chunk
            (number, start, min(start + reader.frames_per_chunk, reader.n_frames))
            for number, reader in enumerate(readers)
            for start in range(0, reader.n_frames, reader.frames_per_chunk)
        ]
        self._starts = np.cumsum([0] + [stop - start for _, start, stop in self.chunks])
        self._kept: OrderedDict[int, Arrays] = OrderedDict()
        self._bytes = 0
        self.reads = 0  # of chunks, so far

    def __len__(self) -> int:
        return int(self._starts[-1])

    @property
    def lengths(self) -> list[int]:
        """Number of frames of each chunk."""
        return np.diff(self._starts).tolist()

    def chunk(self, number: int) -> Arrays:
        """The arrays of one chunk; treat them as read only."""
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        reader, start, stop = self.chunks[number]
        arrays = self._make(self._readers[reader].clip(start, stop))
        self.reads += 1
        self._kept[number] = arrays
        self._bytes += _size(arrays)
        while self._bytes > self._limit and len(self._kept) > 1:
            self._bytes -= _size(self._kept.popitem(last=False)[1])
        return arrays

    @property
    def clip_starts(self) -> np.ndarray:
        """(frames,) int64: of each frame, the number of its clip's first."""
        firsts = [
            start for start, (_, first, _) in zip(self._starts[:-1], self.chunks, strict=True) if first == 0
        ]
        readers = np.array([reader for reader, _, _ in self.chunks])
        return np.repeat(np.array(firsts)[readers], self.lengths)

    def frames(self, index: Sequence[int] | np.ndarray, arrays: slice = slice(None)) -> Arrays:
        """The arrays of frames `index` (B,), or those of the `arrays` named: stacked, so that the first axis is B."""
        index = np.asarray(index)
        numbers = np.searchsorted(self._starts, index, side="right") - 1
        # Chunk by chunk, not frame by frame: a small cache must not read one chunk twice for a batch.
        by_row: dict[int, Arrays] = {}
        for number in np.unique(numbers):
            made = self.chunk(int(number))[arrays]
            for row in np.flatnonzero(numbers == number):
                within = int(index[row] - self._starts[number])
                by_row[int(row)] = tuple(values[within] for values in made)
        rows = [by_row[row] for row in range(len(index))]
        return tuple(np.stack(values) for values in zip(*rows, strict=True))


def _size(arrays: Arrays) -> int:
    return sum(values.nbytes for values in arrays)
