"""The numbers of an OBJ file's lines, a million lines at a time."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

_IS_SPACE = np.zeros(256, bool)
_IS_SPACE[[9, 10, 32]] = True
_SLASH, _SPACE, _NEWLINE = 47, 32, 10
LARGEST_INDEX = 2**31  # beyond it no file has vertices


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of faces.

    Args:
        counts: (F,) int64 corners of each face.
        vertices, uvs: (sum of counts,) int64 as written, from 1, or backwards from -1; uvs 0 where there is none.
    """

    counts: np.ndarray
    vertices: np.ndarray
    uvs: np.ndarray


def gathered(buffer: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The bytes of lines, each with the line feed at its end.

    Args:
        buffer: (B,) uint8. starts, ends: (L,) where lines begin, and where their line feeds are.
    """
    if not len(starts):
        return buffer[:0]
    breaks = np.flatnonzero(starts[1:] != ends[:-1] + 1)  # between lines that do not follow each other
    firsts, lasts = np.append(0, breaks + 1), np.append(breaks, len(starts) - 1)
    runs = zip(starts[firsts].tolist(), (ends[lasts] + 1).tolist(), strict=True)
    return np.concatenate([buffer[a:b] for a, b in runs])


def columns(lines: np.ndarray, wanted: int, least: int) -> np.ndarray:
    """The first numbers of each line.

    Args:
        lines: (B,) uint8, numbers apart by blanks, each line ended.
        wanted: how many numbers of each line are taken; further ones may follow.
        least: as many every line must have; those missing are 0.

    Returns:
        (L, wanted) float64.

    Raises:
        ValueError: a line with fewer numbers, or with something else than numbers.
    """
    begins = _begins(_IS_SPACE[lines])
    counts = _per_line(begins, lines)
    numbers = _numbers(lines.tobytes(), np.float64, int(counts.sum()))
    if len(counts) and counts.min() < least:
        raise ValueError("a line has too few numbers")
    if len(counts) and (counts == counts[0]).all():
        table = numbers.reshape(len(counts), -1)[:, :wanted]
        return np.pad(table, ((0, 0), (0, wanted - table.shape[1])))
    table = np.zeros((len(counts), wanted))
    offsets = np.cumsum(counts) - counts
    for column in range(wanted):
        there = counts > column
        table[there, column] = numbers[offsets[there] + column]
    return table


def corners(lines: np.ndarray) -> Corners:
    """The corners of face lines, such as `1 2 3`, `1/1 2/2 3/3`, `1//7 2//7 3//7`, `1/1/7 2/2/7 3/3/7`.

    Args:
        lines: (B,) uint8 without the keyword, each line ended.

    Raises:
        ValueError: a face with fewer than three corners, or something else than indices.
    """
    space, slash = _IS_SPACE[lines], lines == _SLASH
    words = _begins(space)
    counts = _per_line(words, lines)
    if counts.min(initial=3) < 3:
        raise ValueError("a face has fewer than three corners")
    total = int(counts.sum())
    if not slash.any():
        vertices = _numbers(lines.tobytes(), np.int64, total)
        return Corners(counts, _checked(vertices), np.zeros(total, np.int64))
    separator = space | slash
    numbers = _begins(separator)
    if (words & slash).any():
        raise ValueError("a corner has no vertex")
    values = _numbers(np.where(slash, np.uint8(_SPACE), lines).tobytes(), np.int64, int(numbers.sum()))
    # The slot of a number is how many slashes of its word are before it: 0 vertex, 1 texture coordinate, 2 normal.
    at, word_at = np.flatnonzero(numbers), np.flatnonzero(words)
    slashes = np.cumsum(slash, dtype=np.int32)
    word = np.cumsum(words, dtype=np.int32)[at] - 1
    slot = slashes[at] - slashes[word_at][word]
    uvs = np.zeros(total, np.int64)
    uvs[word[slot == 1]] = values[slot == 1]
    return Corners(counts, _checked(values[slot == 0]), _checked(uvs))


def fans(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Polygons as triangles around their first corner.

    Args:
        counts: (F,) corners of each polygon, three or more.

    Returns:
        (T, 3) int64 places of the triangles' corners among all corners, and (T,) int64 the polygon of each.
    """
    offsets = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    first = np.cumsum(counts - 2) - (counts - 2)
    second = offsets[polygon] + np.arange(len(polygon)) - first[polygon] + 1
    return np.stack([offsets[polygon], second, second + 1], axis=-1), polygon


def _begins(separator: np.ndarray) -> np.ndarray:
    """Where something that is no separator follows one, or the start."""
    begins = ~separator
    begins[1:] &= separator[:-1]
    return begins


def _per_line(begins: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(L,) int64 words that begin in each line."""
    ends = np.flatnonzero(lines == _NEWLINE)
    if not len(ends):
        return np.zeros(0, np.int64)
    starts = np.append(0, ends[:-1] + 1)
    return np.add.reduceat(begins, starts, dtype=np.int64)


def _numbers(text: bytes, dtype: type, count: int) -> np.ndarray:
    if not count:
        return np.zeros(0, dtype)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "error", DeprecationWarning
        )  # which older NumPy gives for text that is no number
        try:
            numbers: np.ndarray = np.fromstring(text, dtype, sep=" ")
        except DeprecationWarning as error:
            raise ValueError(str(error)) from None
    if len(numbers) != count:  # "1-2" is no two numbers
        raise ValueError("words that are not numbers")
    return numbers


def _checked(indices: np.ndarray) -> np.ndarray:
    if len(indices) and max(indices.max(), -indices.min()) > LARGEST_INDEX:
        raise ValueError("an index is too large")
    return indices
