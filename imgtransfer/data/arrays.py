"""One array of a stored clip: encoded and checked by chunks of frames, so that any frame can be read alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from zarr.abc.store import Store
from zarr.codecs import BloscCodec, Crc32cCodec

from imgtransfer.data import grid

FRAMES_PER_CHUNK = 32
_ENCODING = "second-differences-by-chunk"
_ENCODING_V1 = "second-differences"  # over the whole clip


def write_array(store: Store, values: np.ndarray, *, by_frame: bool) -> None:
    """Write an array to an empty store.

    Chunks carry a checksum, all of them are stored, and the fill value is one that no clip holds (NaN, the smallest
    integer): a chunk that is damaged or lost is an error on reading, never zeros.

    Args:
        values: numbers; where `by_frame`, the first axis is time, chunked by 32 frames, and float32 positions on the
            grid of `imgtransfer.data.grid` are stored as differences in time, which start anew in each chunk.
    """
    step = FRAMES_PER_CHUNK if by_frame else max(1, len(values))
    attributes: dict[str, Any] = {}
    if by_frame and grid.lies_on_grid(values):
        parts = [grid.to_differences(values[at : at + step]) for at in range(0, len(values), step)]
        values, attributes = np.concatenate(parts), {"encoding": _ENCODING, "step": grid.STEP}
    shape = values.shape
    array = zarr.create_array(
        store,
        shape=shape,
        dtype=values.dtype,
        chunks=tuple(max(1, length) for length in (min(step, shape[0]), *shape[1:])),
        compressors=(
            BloscCodec(cname="zstd", clevel=9, shuffle="bitshuffle" if attributes else "shuffle"),
            Crc32cCodec(),
        ),
        fill_value=_never_stored(values.dtype),
        attributes=attributes,
        zarr_format=3,
        config={"write_empty_chunks": True},
    )
    array[...] = values


def _never_stored(dtype: np.dtype) -> float:
    """A value that no clip holds: NaN, or the integer farthest from 0."""
    if dtype.kind == "f":
        return np.nan
    limits = np.iinfo(dtype)
    return int(limits.min or limits.max)


class StoredArray:
    """An array that `write_array` wrote, or one of a data set of schema version 1.

    Args:
        store: its store.

    Raises:
        ValueError, OSError, KeyError: it is missing or cannot be understood.
    """

    def __init__(self, store: Store) -> None:
        array = zarr.open_array(store, mode="r", zarr_format=3)
        if not isinstance(array, zarr.Array):
            raise ValueError("not an array")
        self._array = array
        encoding: Any = array.attrs.get("encoding")
        if encoding not in (None, _ENCODING, _ENCODING_V1):
            raise ValueError(f"unknown encoding {encoding!r}")
        self._encoding: str | None = encoding
        self.shape: tuple[int, ...] = array.shape
        self.frames_per_chunk: int = max(1, array.chunks[0]) if array.chunks else 1

    def read(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Rows `start` to `stop` (all by default) of the first axis, bit for bit as they were written.

        Raises:
            ValueError, OSError, RuntimeError: a chunk of them is lost or damaged.
        """
        stop = self.shape[0] if stop is None else stop
        every = self.frames_per_chunk
        # Differences need the rows before them: from the start of the chunk, in version 1 from the start of the clip.
        first = {None: start, _ENCODING: start // every * every, _ENCODING_V1: 0}[self._encoding]
        values = np.asarray(self._array[first:stop])
        self._check(values, first)
        if self._encoding is None:
            return values
        size = float(self._array.attrs["step"])  # type: ignore[arg-type]
        if self._encoding == _ENCODING_V1:
            every = max(1, len(values))
        parts = [grid.from_differences(values[at : at + every], size) for at in range(0, len(values), every)]
        return np.concatenate(parts)[start - first :] if parts else values.astype(np.float32)

    def _check(self, values: np.ndarray, first: int) -> None:
        """Raise ValueError where a chunk is missing; Zarr fills it with the fill value."""
        fill = np.asarray(self._array.fill_value)
        if values.size == 0 or fill == 0:  # version 1 left out chunks of zeros
            return
        to_next = -first % self.frames_per_chunk
        rows = np.unique([0, *range(to_next, len(values), self.frames_per_chunk)]).astype(int)
        probes = values.reshape(len(values), -1)[rows, 0]
        lost = np.isnan(probes) if np.isnan(fill) else probes == fill
        if lost.any():
            chunk = (first + int(rows[lost.argmax()])) // self.frames_per_chunk
            raise ValueError(f"chunk {chunk} is missing")
