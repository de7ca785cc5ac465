"""Clips read by frames: of a data set only the chunks that hold them, of an npz as it comes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from imgtransfer.data.arrays import StoredArray
from imgtransfer.data.clip import REQUIRED, Clip, check_clip_npz, clip_parts, with_texture_paths
from imgtransfer.data.clip_checks import check_arrays
from imgtransfer.data.metadata import ClipAttributes, read_arrays
from imgtransfer.data.place import METADATA, Place
from imgtransfer.data.schema import ARRAYS, NEVER_ZERO, PER_FRAME, REQUIRED_ARRAYS
from render import InputError
from render.files.npz import open_npz
from render.mesh.mesh import zero_frame


class Reader(Protocol):
    """A clip whose frames are read when they are asked for."""

    @property
    def name(self) -> str:
        """The clip's name."""
        ...

    @property
    def n_frames(self) -> int:
        """Its length."""
        ...

    @property
    def frames_per_chunk(self) -> int:
        """Frames that are read together; other requests are cut out of such chunks."""
        ...

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        """The clip with only the frames from `start` to `stop`; all of them by default."""
        ...

    def parts(self, count: int) -> Iterator[Clip]:
        """All frames in order, `count` at a time; the last part may be shorter."""
        ...


@dataclass(frozen=True, eq=False)
class LoadedReader:
    """A clip that is in memory."""

    whole: Clip

    @property
    def name(self) -> str:
        return self.whole.name

    @property
    def n_frames(self) -> int:
        return self.whole.n_frames

    @property
    def frames_per_chunk(self) -> int:
        return self.whole.n_frames

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        return self.whole.slice(slice(start, stop))

    def parts(self, count: int) -> Iterator[Clip]:
        return (self.clip(first, first + count) for first in range(0, self.n_frames, count))


@dataclass(frozen=True, eq=False)
class NpzReader:
    """A clip npz, which can only be read from its beginning: once for each request."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.stem

    @cached_property
    def n_frames(self) -> int:
        with open_npz(self.path, "a clip npz") as npz:  # the shape stands at the head of the array
            check_clip_npz(npz, self.path)
            return npz.shape("body_vertices")[0]

    @property
    def frames_per_chunk(self) -> int:
        return self.n_frames

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        start, stop, _ = slice(start, stop).indices(self.n_frames)
        return next(self.parts(max(stop, 1))).slice(slice(start, stop))

    def parts(self, count: int) -> Iterator[Clip]:
        with open_npz(self.path, f"a clip npz (keys: {', '.join(REQUIRED)})") as npz:
            yield from clip_parts(npz, self.path, count)


@dataclass(frozen=True, eq=False)
class StoredReader:
    """A clip of a data set. Chunks are read and decoded when they are asked for, and not kept.

    Args:
        place: of the data set; where: its path or URL, for messages.
        name: the clip's.
        attributes: the clip's, from its group.

    Raises:
        InputError: by every method: something of the clip is missing or damaged.
    """

    place: Place
    where: str
    name: str
    attributes: ClipAttributes

    @property
    def n_frames(self) -> int:
        return self.attributes.frames

    @property
    def frames_per_chunk(self) -> int:
        return self._arrays["body_vertices"].frames_per_chunk

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Names of the clip's arrays. Version 1 did not list them, so they are looked for."""
        if self.attributes.arrays is not None:
            return tuple(self.attributes.arrays)
        return tuple(key for key in ARRAYS if self.place.exists(f"{self.name}/{key}/{METADATA}"))

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        """The clip with only the frames from `start` to `stop`, bit for bit as they were written.

        Raises:
            InputError: an array or a chunk is missing or damaged.
        """
        start, stop, _ = slice(start, stop).indices(self.n_frames)
        values = {
            key: self._read(key, start, stop) if key in PER_FRAME else self._static[key] for key in self.keys
        }
        try:
            return Clip.of_arrays(
                values,
                fps=self.attributes.fps,
                info=with_texture_paths(self.attributes.info, self.place.folder),
                name=self.name,
            )
        except InputError as error:
            raise InputError(f"{self.where}: clip {error}") from error

    def parts(self, count: int) -> Iterator[Clip]:
        """All frames in order, `count` at a time, from as many chunks as make whole parts.

        Raises:
            InputError: as `clip`.
        """
        together = max(1, self.frames_per_chunk // count) * count
        for first in range(0, self.n_frames, together):
            some = self.clip(first, first + together)
            yield from LoadedReader(some).parts(count)

    @cached_property
    def _arrays(self) -> dict[str, StoredArray]:
        """The clip's arrays, of which the metadata are known to fit each other and the clip's."""
        missing = [key for key in REQUIRED_ARRAYS if key not in self.keys]
        if missing:
            raise InputError(f"{self._whole_name} lacks {', '.join(missing)}; write it again")
        folders = [f"{self.name}/{key}" for key in self.keys]
        try:
            described = read_arrays(self.place, folders, self.where)
        except InputError as error:
            raise InputError(f"{self._whole_name} cannot be read: {error}") from error
        arrays = {
            key: StoredArray(self.place, folder, metadata)
            for key, folder, metadata in zip(self.keys, folders, described, strict=True)
        }
        for key in PER_FRAME:
            if key in arrays and arrays[key].shape[0] != self.n_frames:
                raise InputError(
                    f"{self.where}/{self.name}/{METADATA}: frames is {self.n_frames}, but {key} has "
                    f"{arrays[key].shape[0]}; write the clip again, or restore it from a copy"
                )
        check_arrays({key: (array.shape, array.dtype) for key, array in arrays.items()}, self._whole_name)
        return arrays

    @cached_property
    def _static(self) -> dict[str, np.ndarray]:
        return {key: self._read(key, 0, None) for key in self.keys if key not in PER_FRAME}

    def _read(self, key: str, start: int, stop: int | None) -> np.ndarray:
        array = self._arrays[key]
        try:
            values = array.read(start, stop)
        except InputError as error:
            raise InputError(f"{self._whole_name} cannot be read: {error}") from error
        except Exception as error:  # a damaged chunk makes decoders raise whatever they meet
            raise self._damaged(key, error) from error
        # Version 1 did not tell lost chunks from zeros; a mesh has no frame of zeros.
        if key in NEVER_ZERO and zero_frame(values if key in PER_FRAME else values[None]) is not None:
            raise self._damaged(key, ValueError("it reads as zeros: chunks are missing"))
        return values

    @property
    def _whole_name(self) -> str:
        return f"{self.where}: clip {self.name}"

    def _damaged(self, key: str, error: Exception) -> InputError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return InputError(
            f"{self._whole_name} cannot be read, the store is damaged: {key}: {reason}; "
            "write the clip again, or restore it from a copy"
        )
