"""Npz files written array by array or row by row, in constant memory."""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from render.files import written_whole
from render.npz import COPY_BYTES, SUFFIX


class NpzWriter:
    """An npz file that is written array by array, or row by row; it appears whole when the block ends without an error.

        with NpzWriter(path) as out:
            out.write("faces", faces)
            for part in parts:
                out.append("vertices", part)

    Rows wait in files of their own beside `path` (a zip file takes one member at a time), not in memory.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(path)
        self._written = written_whole(self._path)
        self._waiting: dict[str, _Rows] = {}

    def __enter__(self) -> NpzWriter:
        temporary = self._written.__enter__()
        self._archive = zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED)
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
                    with self._archive.open(name + SUFFIX, "w", force_zip64=True) as member:
                        rows.copy_to(member)
            self._archive.close()
        except BaseException as failure:
            self._written.__exit__(type(failure), failure, failure.__traceback__)
            raise
        finally:
            for rows in self._waiting.values():
                rows.close()
        self._written.__exit__(kind, error, trace)


class _Rows:
    """Rows of an array that wait in a file without a name."""

    def __init__(self, dtype: np.dtype[Any], shape: tuple[int, ...], folder: Path) -> None:
        self._dtype, self._shape, self._count = dtype, shape, 0
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - `close` ends it

    def add(self, rows: np.ndarray) -> None:
        if rows.dtype != self._dtype or rows.shape[1:] != self._shape:
            raise ValueError(
                f"rows of {self._dtype} {self._shape} are wanted, found {rows.dtype} {rows.shape[1:]}"
            )
        self._file.write(np.ascontiguousarray(rows).data)
        self._count += len(rows)

    def copy_to(self, member: IO[bytes]) -> None:
        description = np.lib.format.dtype_to_descr(self._dtype)
        header = {"descr": description, "fortran_order": False, "shape": (self._count, *self._shape)}
        np.lib.format.write_array_header_1_0(member, header)
        self._file.seek(0, os.SEEK_SET)
        shutil.copyfileobj(self._file, member, COPY_BYTES)

    def close(self) -> None:
        self._file.close()


def write_npz(path: Path | str, arrays: Mapping[str, Any]) -> None:
    """Write arrays, compressed; the file appears whole or not at all."""
    with NpzWriter(Path(path)) as out:
        for name, values in arrays.items():
            out.write(name, values)
