"""Npz files written array by array or row by row, in constant memory."""

from __future__ import annotations

import io
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from render.files.atomic import written_whole
from render.files.npz import COPY_BYTES, SUFFIX

# Maps and vertices are noise in their last bits: beside zlib's default, 6, this takes half of the time and
# gives files that are 1.4 % larger.
_LEVEL = 1
# Of rows: what repeats in maps is their background, a run, and in vertices nothing. Beside searching for all matches at
# the same level this takes less than half of the time, and gives maps that are 2 % smaller.
_ROWS_STRATEGY = zlib.Z_RLE


class NpzWriter:
    """An npz file that is written array by array, or row by row; it appears whole when the block ends without an error.

        with NpzWriter(path) as out:
            out.write("faces", faces)
            for part in parts:
                out.append("vertices", part)

    Rows are compressed as they come, and wait in files of their own beside `path` (a zip file takes one member at a
    time), not in memory.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(path)
        self._written = written_whole(self._path)
        self._waiting: dict[str, _Rows] = {}

    def __enter__(self) -> NpzWriter:
        temporary = self._written.__enter__()
        self._archive = zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL)
        return self

    def write(self, name: str, values: Any) -> None:
        """Write a whole array of plain numbers or text."""
        values = np.asanyarray(values)
        with self._archive.open(name + SUFFIX, "w", force_zip64=True) as member:
            np.lib.format.write_array(member, values, allow_pickle=False)

    def append(self, name: str, rows: np.ndarray) -> None:
        """Add rows to the array `name`; all its parts have one dtype and shape but for the first axis."""
        if name not in self._waiting:
            self._waiting[name] = _Rows(rows.dtype, rows.shape[1:], self._path.parent)
        self._waiting[name].add(rows)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                for name, rows in self._waiting.items():
                    rows.move_to(self._archive, name)
            self._archive.close()
        except BaseException as failure:
            self._written.__exit__(type(failure), failure, failure.__traceback__)
            raise
        finally:
            for rows in self._waiting.values():
                rows.close()
        self._written.__exit__(kind, error, trace)


class _Rows:
    """Rows of an array, compressed, that wait in a file without a name."""

    def __init__(self, dtype: np.dtype[Any], shape: tuple[int, ...], folder: Path) -> None:
        self._dtype, self._shape, self._count = dtype, shape, 0
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - `close` ends it
        self._deflate = zlib.compressobj(_LEVEL, wbits=-zlib.MAX_WBITS, strategy=_ROWS_STRATEGY)
        self._bytes = self._sum = 0

    def add(self, rows: np.ndarray) -> None:
        if rows.dtype != self._dtype or rows.shape[1:] != self._shape:
            raise ValueError(
                f"rows of {self._dtype} {self._shape} are wanted, found {rows.dtype} {rows.shape[1:]}"
            )
        content = np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data
        self._sum = zlib.crc32(content, self._sum)
        self._bytes += len(content)
        self._count += len(rows)
        self._file.write(self._deflate.compress(content))

    def move_to(self, archive: zipfile.ZipFile, name: str) -> None:
        """Make them a member of the archive: what is compressed is copied, behind the header that tells their count."""
        self._file.write(self._deflate.flush())
        description = {
            "descr": np.lib.format.dtype_to_descr(self._dtype),
            "fortran_order": False,
            "shape": (self._count, *self._shape),
        }
        text = io.BytesIO()
        np.lib.format.write_array_header_1_0(text, description)
        header = text.getvalue()
        start = zlib.compressobj(_LEVEL, wbits=-zlib.MAX_WBITS)
        before = start.compress(header) + start.flush(
            zlib.Z_FULL_FLUSH
        )  # ends at a byte, and more may follow
        info = zipfile.ZipInfo(name + SUFFIX)  # without a date: the same arrays give the same bytes
        info.compress_type = zipfile.ZIP_DEFLATED
        info.external_attr = 0o600 << 16
        info.CRC = joined_crc32(zlib.crc32(header), self._sum, self._bytes)
        info.file_size = len(header) + self._bytes
        info.compress_size = len(before) + self._file.tell()
        # zipfile has no way to add what is compressed already; these attributes are as old as the module.
        target = archive.fp
        assert target is not None
        target.seek(archive.start_dir)
        info.header_offset = archive.start_dir
        target.write(info.FileHeader(zip64=True) + before)
        self._file.seek(0)
        shutil.copyfileobj(self._file, target, COPY_BYTES)
        archive.start_dir = target.tell()
        archive.filelist.append(info)
        archive.NameToInfo[info.filename] = info

    def close(self) -> None:
        self._file.close()


def joined_crc32(first: int, second: int, length: int) -> int:
    """CRC-32 of two texts in a row from those of each, the second being of `length` bytes.

    A zero bit behind a text changes its CRC by a linear map; squared three times, that is a zero byte, and so on.
    """
    zeros = [0xEDB88320, *(1 << bit for bit in range(31))]  # column by column
    for _ in range(3):
        zeros = [_times(zeros, column) for column in zeros]
    while length:
        if length & 1:
            first = _times(zeros, first)
        zeros = [_times(zeros, column) for column in zeros]
        length >>= 1
    return first ^ second


def _times(matrix: list[int], vector: int) -> int:
    """Product of bits, sums being exclusive ors."""
    product = 0
    for column in matrix:
        if vector & 1:
            product ^= column
        vector >>= 1
    return product


def write_npz(path: Path | str, arrays: Mapping[str, Any]) -> None:
    """Write arrays, compressed; the file appears whole or not at all."""
    with NpzWriter(Path(path)) as out:
        for name, values in arrays.items():
            out.write(name, values)
