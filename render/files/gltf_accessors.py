"""Arrays of glTF files: what accessors say of the bytes of buffers (glTF 2.0 specification, section 3.6)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError
from render.files.glb import Document

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Accessors:
    """The numbered arrays of a file.

    Args:
        path: the file, for messages.
        document: what it holds.
    """

    def __init__(self, path: Path, document: Document) -> None:
        self.path, self.header, self.buffers = path, document.header, document.buffers

    def count(self, number: int) -> int:
        """How many elements an accessor has."""
        return int(self.header["accessors"][number]["count"])

    def values(self, number: int, kind: str, dtype: type[np.floating] = np.float64) -> np.ndarray:
        """(count, width) floating point; what is normalised lies within [-1, 1].

        Args:
            number: the accessor.
            kind: "SCALAR", "VEC2", "VEC3", "VEC4" or "MAT4", which is 16 values by columns.
            dtype: of the result.

        Raises:
            InputError: as `table`.
        """
        table = self.table(number, kind)
        if self.header["accessors"][number].get("normalized", False):
            return np.maximum(table / np.iinfo(table.dtype).max, -1.0).astype(dtype)
        return table.astype(dtype)

    def whole_numbers(self, number: int, kind: str, *, below: int) -> np.ndarray:
        """(count, width) int64, from 0 on and smaller than `below`.

        Raises:
            InputError: as `table`, or other numbers.
        """
        table = self.table(number, kind)
        if table.dtype.kind != "u":
            raise InputError(f"{self.path}: accessor {number} must hold unsigned whole numbers")
        if table.size and table.max() >= below:  # here, where the numbers are small still
            raise InputError(f"{self.path}: accessor {number} holds {table.max()}, of {below} that there are")
        return table.astype(np.int64)

    def table(self, number: int, kind: str) -> np.ndarray:
        """(count, width) as it is stored: a view of the buffer.

        Raises:
            InputError: data that are sparse, not there, of another kind, or that reach beyond their buffer.
        """
        accessor = self.header["accessors"][number]
        if "sparse" in accessor:
            raise InputError(
                f"{self.path}: accessor {number} is sparse, which is not read; export it in full"
            )
        if "bufferView" not in accessor:
            raise InputError(
                f"{self.path}: accessor {number} has no data here (the file uses {self._used()})"
            )
        if accessor["type"] != kind:
            raise InputError(f"{self.path}: accessor {number} is {accessor['type']}, not {kind}")
        dtype, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[kind]
        count = int(accessor["count"])
        view = self.header["bufferViews"][accessor["bufferView"]]
        buffer = self._buffer(view)
        stride = int(view.get("byteStride") or dtype.itemsize * width)
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        inside = int(accessor.get("byteOffset", 0))
        needed = inside + stride * (count - 1) + dtype.itemsize * width if count else 0
        if min(start, inside, stride) < 0 or needed > length or start + length > len(buffer):
            raise InputError(
                f"{self.path}: accessor {number} reaches beyond its buffer: the file is cut or wrong"
            )
        if not count:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, buffer, start + inside, (stride, dtype.itemsize))

    def _buffer(self, view: dict[str, Any]) -> memoryview:
        """The bytes that a view is of: of a compressed one the plain copy, where the file has it."""
        buffer: memoryview | None = self.buffers[view["buffer"]]
        if buffer is None:
            raise InputError(
                f"{self.path}: has data only as {self._used()} packs them, which is not read; export it without "
                "compression"
            )
        return buffer

    def _used(self) -> str:
        return ", ".join(map(str, self.header.get("extensionsUsed", []))) or "no extension"
