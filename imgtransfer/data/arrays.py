"""One array of a stored clip: encoded and checked by chunks of frames, so that any frame can be read alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import zarr
from zarr.abc.store import Store
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import MemoryStore

from imgtransfer.data import grid
from imgtransfer.data.metadata import ArrayMetadata
from imgtransfer.data.place import METADATA, Place
from render.memory import available_bytes

FRAMES_PER_CHUNK = 32
_ENCODING = "second-differences-by-chunk"
_ENCODING_V1 = "second-differences"  # over the whole clip
_PART = 64 << 20  # bytes of chunks that are fetched and decoded together
_MOST_CHUNKS = 100_000


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

    Chunks are fetched and compared with the array's shape here, so that neither their number nor what they claim to
    hold is believed; Zarr then decodes them from memory.

    Args:
        place: of the data set. folder: of the array, below it. metadata: the array's.
    """

    def __init__(self, place: Place, folder: str, metadata: ArrayMetadata) -> None:
        self._place, self._folder, self._metadata = place, folder, metadata
        self.shape = tuple(metadata.shape)
        self.frames_per_chunk = metadata.chunks[0]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of what `read` returns."""
        return self._metadata.dtype if self._metadata.attributes.encoding is None else np.dtype(np.float32)

    def read(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Rows `start` to `stop` (all by default) of the first axis, bit for bit as they were written.

        Raises:
            ValueError, OSError, RuntimeError: a chunk of them is lost or damaged, or they are too large.
        """
        stop = self.shape[0] if stop is None else stop
        encoding, step = self._metadata.attributes.encoding, self._metadata.attributes.step
        every = self.frames_per_chunk
        # Differences need the rows before them: from the start of the chunk, in version 1 from the start of the clip.
        first = {None: start, _ENCODING: start // every * every, _ENCODING_V1: 0}[encoding]
        self._check_memory(stop - first)
        per_part = max(1, _PART // max(1, self._metadata.chunk_bytes)) * every  # rows
        ends = [*range(first // every * every + per_part, stop, per_part), stop]
        starts = [first, *ends[:-1]]
        parts = [self._rows(begin, end) for begin, end in zip(starts, ends, strict=True)]
        values = np.concatenate(parts) if len(parts) > 1 else parts[0]
        if encoding is None:
            return values
        assert step is not None  # the metadata were checked
        if encoding == _ENCODING_V1:
            every = max(1, len(values))
        parts = [grid.from_differences(values[at : at + every], step) for at in range(0, len(values), every)]
        return np.concatenate(parts)[start - first :] if parts else values.astype(np.float32)

    def _check_memory(self, rows: int) -> None:
        needed, free = rows * math.prod(self.shape[1:]) * self._metadata.dtype.itemsize, available_bytes()
        if free is not None and needed > free:
            raise ValueError(
                f"{needed / 2**30:.1f} GiB of memory are needed, and {free / 2**30:.1f} GiB are free"
            )

    def _rows(self, start: int, stop: int) -> np.ndarray:
        """Stored rows, from the chunks that hold them."""
        metadata = self._metadata
        counts = [-(-length // size) for length, size in zip(self.shape, metadata.chunks, strict=True)]
        rows = range(start // self.frames_per_chunk, -(-stop // self.frames_per_chunk))
        if len(rows) * math.prod(counts[1:]) > _MOST_CHUNKS:
            raise ValueError(f"chunks of shape {metadata.chunks} divide {self.shape} into far too many")
        keys = {place: metadata.chunk_key(place) for place in product(rows, *map(range, counts[1:]))}
        limit = (
            metadata.chunk_bytes + metadata.chunk_bytes // 64 + 4096
        )  # what does not compress grows a little
        contents = self._place.read_many([f"{self._folder}/{key}" for key in keys.values()], limit)
        memory: dict[str, Buffer] = {METADATA: _buffer(metadata.model_dump_json(exclude_none=True).encode())}
        for (place, key), content in zip(keys.items(), contents, strict=True):
            if content is None:
                if metadata.fill_value == 0:  # version 1 left out chunks of zeros
                    continue
                raise ValueError(f"chunk {place[0]} is missing")
            size = _size_inside(content, [codec.name for codec in metadata.codecs])
            if size != metadata.chunk_bytes:
                raise ValueError(f"chunk {place[0]} holds {size} bytes, {metadata.chunk_bytes} are wanted")
            memory[key] = _buffer(content)
        array = zarr.open_array(MemoryStore(memory), mode="r", zarr_format=3)
        return np.asarray(array[start:stop])


def _buffer(content: bytes) -> Buffer:
    return default_buffer_prototype().buffer.from_bytes(content)


def _size_inside(content: bytes, codecs: Sequence[str]) -> int:
    """How many bytes an encoded chunk says that it holds, without decoding it; -1 where it does not say."""
    if codecs[-1] == "crc32c":
        content = content[:-4]
    if "blosc" in codecs:  # version, of the codec, flags, size of a type, then this size
        return int.from_bytes(content[4:8], "little") if len(content) >= 16 else -1
    if "zstd" not in codecs:
        return len(content)
    if content[:4] != b"\x28\xb5\x2f\xfd" or len(content) < 6:
        return -1
    kind, single = content[4] >> 6, content[4] >> 5 & 1
    start = 5 + (1 - single) + (0, 1, 2, 4)[content[4] & 3]  # a window's description, a dictionary's number
    length = (single, 2, 4, 8)[kind]
    size = int.from_bytes(content[start : start + length], "little")
    return (size + 256 if kind == 1 else size) if length else -1
