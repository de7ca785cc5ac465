"""Frames that are read when they are shown: some of them stay in memory, however long the clip."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from imgtransfer.data.clip import Clip
from imgtransfer.data.reader import NpzReader, Reader
from render import MapFile, Maps

Part = TypeVar("Part")

# Of a clip, that are read together; fewer or more only by chunks.
_FRAMES, _MOST_FRAMES = 16, 64
_MAP_FRAMES = 2  # of maps, which are some hundred times larger
_KEPT = 4  # parts that stay in memory


class Window(Generic[Part]):
    """Parts of equally many frames, of which those that were asked for last are kept.

    Args:
        count: frames of a part.
        read: the part of a number, from 0 on.
    """

    def __init__(self, count: int, read: Callable[[int], Part]) -> None:
        self._count, self._read = count, read
        self._kept: OrderedDict[int, Part] = OrderedDict()

    def __call__(self, frame: int) -> tuple[Part, int]:
        """The part that holds a frame, and the frame's row in it.

        Raises:
            InputError: what cannot be read.
        """
        number, row = divmod(frame, self._count)
        if number not in self._kept:
            self._kept[number] = self._read(number)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(number)
        return self._kept[number], row


class InOrder(Generic[Part]):
    """Parts by their numbers, from what yields them only in order: it goes on where it stopped, and for an earlier part
    begins again.

    Args:
        parts: all parts in order, from the first on whenever this is called.
    """

    def __init__(self, parts: Callable[[], Iterator[Part]]) -> None:
        self._parts, self._next = parts, 0
        self._coming = parts()

    def __call__(self, number: int) -> Part:
        if number < self._next:
            self._coming, self._next = self._parts(), 0
        for _ in range(number - self._next):
            next(self._coming)
        self._next = number + 1
        return next(self._coming)


def clip_window(reader: Reader) -> Window[Clip]:
    """Frames of a clip: from a data set only the chunks that hold them, from a clip npz as they come."""
    if isinstance(reader, NpzReader):
        return Window(_FRAMES, InOrder(lambda: reader.parts(_FRAMES)))
    count = min(max(reader.frames_per_chunk, _FRAMES), _MOST_FRAMES)
    return Window(count, lambda number: reader.clip(number * count, (number + 1) * count))


def map_window(maps: Maps) -> Window[MapFile]:
    """Frames of a map file, as they come."""
    return Window(_MAP_FRAMES, InOrder(lambda: maps.parts(_MAP_FRAMES)))
