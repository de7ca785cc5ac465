"""A PLY file's header and the numbers behind it, by element and property."""

from __future__ import annotations

import codecs
import re
import warnings
from dataclasses import dataclass, field

import numpy as np

from render.files.text_lines import as_text

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20  # bytes


class PlyError(ValueError):
    """Why a PLY file cannot be read."""


@dataclass(frozen=True)
class Property:
    """`type` of the numbers; `count` of the number before them where they are a list, else None (NumPy's names)."""

    name: str
    type: str
    count: str | None = None


@dataclass(frozen=True)
class Header:
    """Name, count and properties of the `elements`; `order` "<", ">" or "" for text; `start` of the data."""

    order: str
    elements: list[tuple[str, int, list[Property]]]
    textures: list[str]
    start: int


@dataclass(frozen=True, eq=False)
class Element:
    """The values of `count` vertices, faces or others.

    Args:
        columns: (count,) by property. lists: by property, (count,) int64 lengths and all values one after the other.
    """

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def header_of(content: bytes) -> Header:
    """Read the header; PlyError where it is none."""
    mark = len(codecs.BOM_UTF8) if content.startswith(codecs.BOM_UTF8) else 0
    end = re.compile(rb"(\r\n|\n|\r)[ \t]*end_header[ \t]*(\r\n|\n|\r|$)").search(
        content, mark, _LONGEST_HEADER
    )
    lines = re.split(rb"\r\n|\n|\r", content[mark : end.start()]) if end else []
    if end is None or lines[0].strip() != b"ply":
        raise PlyError("no PLY file, which begins with ply and its header")
    order: str | None = None
    elements: list[tuple[str, int, list[Property]]] = []
    textures: list[str] = []
    for line in lines[1:]:
        words = as_text(line).split()
        try:
            match words:
                case ["format", name, *_]:
                    order = _ORDERS[name]
                case ["element", name, count]:
                    elements.append((name, _count(count), []))
                case ["property", "list", count, kind, name]:
                    elements[-1][2].append(Property(name, _TYPES[kind], _TYPES[count]))
                case ["property", kind, name]:
                    elements[-1][2].append(Property(name, _TYPES[kind]))
                case ["comment", "TextureFile", *_]:
                    textures.append(as_text(line).split("TextureFile", 1)[1].strip())
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case _:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            raise PlyError(f"its header has the line '{as_text(line)[:80]}'") from None
    if order is None:
        raise PlyError("its header names no format")
    return Header(order, elements, [name for name in textures if name], end.end())


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 19):
        raise ValueError
    return int(text)


def read_elements(content: bytes, header: Header) -> dict[str, Element]:
    """The elements by name; PlyError where the file ends before them, or holds something else than numbers."""
    text = not header.order
    data = _numbers_of_text(content[header.start :]) if text else np.frombuffer(content, np.uint8)
    at, elements = 0 if text else header.start, dict[str, Element]()
    for name, count, properties in header.elements:
        sizes = [1 if text else np.dtype(p.count or p.type).itemsize for p in properties]
        if count * sum(sizes) > len(data) - at:
            raise PlyError(f"it ends before its {count} {name} elements do")
        rows = _Rows(data, header.order, properties, count, at)
        elements.setdefault(name, rows.element())
        at = rows.end
    return elements


def _numbers_of_text(text: bytes) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter(
            "error", DeprecationWarning
        )  # which older NumPy gives for text that is no number
        try:
            return np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
        except (ValueError, DeprecationWarning):
            raise PlyError("something else than numbers stands behind its header") from None


class _Rows:
    """The rows of one element: numbers of text, or bytes.

    Where every list is as long as in the first row (only triangles, say), rows are a table; else where each begins is
    found row by row. Places count numbers of text, or bytes.
    """

    def __init__(
        self, data: np.ndarray, order: str, properties: list[Property], count: int, start: int
    ) -> None:
        self.data, self.order, self.properties, self.count, self.start = data, order, properties, count, start
        self.end = start

    def element(self) -> Element:
        element = Element()
        if not self.count or not self.properties:
            return element
        starts = self._table() or self._walked()
        for number, part in enumerate(self.properties):
            places, lengths = starts[number]
            if part.count is None:
                element.columns[part.name] = self._take(places, part.type)
            else:
                size = self._size(part.type)
                offsets = np.cumsum(lengths) - lengths
                inside = np.arange(int(lengths.sum())) - np.repeat(offsets, lengths)
                values = self._take(np.repeat(places, lengths) + size * inside, part.type)
                element.lists[part.name] = (lengths, values)
        return element

    def _size(self, kind: str) -> int:
        return np.dtype(kind).itemsize if self.order else 1

    def _take(self, places: np.ndarray, kind: str) -> np.ndarray:
        if self.order:
            spread = places[:, None] + np.arange(self._size(kind))
            return np.asarray(self.data[spread].reshape(-1).view(self.order + kind))
        values = np.asarray(self.data[places])
        if kind[0] == "f":
            return values
        if not (np.abs(values) < 2.0**53).all():
            raise PlyError("numbers that are no indices")
        return np.asarray(values.astype(np.int64))

    def _length(self, place: int, kind: str) -> int:
        size = self._size(kind)
        if place + size > len(self.data):
            raise PlyError("it ends within a list")
        value = self._take(np.array([place]), kind)[0]
        if not 0 <= value <= len(self.data) or value != int(value):
            raise PlyError(f"a list of {value} numbers")
        return int(value)

    def _table(self) -> list[tuple[np.ndarray, np.ndarray]] | None:
        """Where each property's values begin in each row, and their lengths, if all rows are as the first."""
        at, offsets, lengths = self.start, [], []
        for part in self.properties:
            length = 1
            if part.count is not None:
                length = self._length(at, part.count)
                at += self._size(part.count)
            offsets.append(at - self.start)
            lengths.append(length)
            at += length * self._size(part.type)
        stride = at - self.start
        if self.start + stride * self.count > len(self.data):
            return None
        rows = self.start + stride * np.arange(self.count)
        for part, offset, length in zip(self.properties, offsets, lengths, strict=True):
            if (
                part.count is not None
                and (self._take(rows + offset - self._size(part.count), part.count) != length).any()
            ):
                return None
        self.end = at + stride * (self.count - 1)
        return [
            (rows + offset, np.full(self.count, length))
            for offset, length in zip(offsets, lengths, strict=True)
        ]

    def _walked(self) -> list[tuple[np.ndarray, np.ndarray]]:
        kinds = [
            (self._size(part.type), part.count, self._size(part.count or "u1")) for part in self.properties
        ]
        places = [np.zeros(self.count, np.int64) for _ in kinds]
        lengths = [np.ones(self.count, np.int64) for _ in kinds]
        at, total = self.start, len(self.data)
        for row in range(self.count):
            for number, (size, count, count_size) in enumerate(kinds):
                length = 1
                if count is not None:
                    # One byte, as almost all files have it, is read without NumPy's detours.
                    single = count == "u1" and self.order and at < total
                    length = int(self.data[at]) if single else self._length(at, count)
                    at += count_size
                    lengths[number][row] = length
                places[number][row] = at
                at += length * size
            if at > total:
                raise PlyError(f"it ends in row {row} of {self.count}")
        self.end = at
        return list(zip(places, lengths, strict=True))
