"""The one door to npz files: nothing is unpickled, nothing believed before it is checked, long arrays pass by rows."""

from __future__ import annotations

import lzma
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from render.errors import InputError
from render.files.atomic import check_regular
from render.memory import available_bytes

SUFFIX = ".npy"
_KINDS = "biufcUS"  # numbers and text: what plain arrays are made of
COPY_BYTES = 1 << 20
_LARGEST_AXIS = 2**40  # of an array without elements, whose size says nothing about its shape
# What damage raises: RuntimeError is zipfile's for encrypted members, and NotImplementedError, its child, for other
# compressions; headers are parsed as Python literals.
_FAULTS: tuple[type[Exception], ...] = (OSError, ValueError, TypeError, EOFError, KeyError, OverflowError)
_FAULTS += (RuntimeError, MemoryError, SyntaxError, tokenize.TokenError)
_FAULTS += (zipfile.BadZipFile, zlib.error, lzma.LZMAError)


@dataclass(frozen=True)
class _Header:
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]

    @property
    def bytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


class Npz:
    """An open npz file; make one with `open_npz`.

    Args:
        path: of the file. archive: it, open for reading.
    """

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self._path, self._archive = path, archive
        members = [info for info in archive.infolist() if not info.filename.endswith("/")]
        self._members = {info.filename.removesuffix(SUFFIX): info for info in members}
        if len(self._members) < len(members):
            raise InputError(f"{path}: holds two arrays of one name; write it again")
        self._headers: dict[str, _Header] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The arrays' names, in the file's order."""
        return tuple(self._members)

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def shape(self, name: str) -> tuple[int, ...]:
        """Of an array, without reading it."""
        return self._header(name).shape

    def dtype(self, name: str) -> np.dtype[Any]:
        """Of an array, without reading it."""
        return self._header(name).dtype

    def read(self, name: str) -> np.ndarray:
        """A whole array.

        Raises:
            InputError: no such array, a damaged one, one of Python objects, or more than the memory that is free.
        """
        self._header(name)  # compares sizes
        with self._member(name) as file:
            return self._rest(file, self._skip_header(file), f"{self._path}: {name}")

    def rows(self, name: str, count: int) -> Iterator[np.ndarray]:
        """An array of at least one axis, `count` rows of its first axis at a time; the last part may be shorter.

        Only so much is in memory; but an array in Fortran's order, whose rows lie apart, is read whole.

        Raises:
            InputError: as `read`.
        """
        header = self._header(name)
        if not header.shape:
            raise InputError(f"{self._path}: {name} is a single number; an array of frames is wanted")
        if header.fortran and len(header.shape) > 1:
            whole = self.read(name)
            yield from (whole[first : first + count] for first in range(0, len(whole), count))
            return
        with self._member(name) as file:
            self._skip_header(file)
            size = header.bytes // max(1, header.shape[0]) * min(count, header.shape[0])
            check_room(size, f"{self._path}: {name} of shape {header.shape}")
            for first in range(0, header.shape[0], count):
                part = np.empty((min(count, header.shape[0] - first), *header.shape[1:]), header.dtype)
                self._fill(file, part.reshape(-1))
                yield part

    def _header(self, name: str) -> _Header:
        if name not in self._headers:
            with self._member(name) as file:
                header = self._skip_header(file)
                start = file.tell()
            stored = self._members[name].file_size - start
            if header.bytes != stored:
                raise InputError(
                    f"{self._path}: {name} says {header.dtype} of shape {header.shape}, {header.bytes} bytes, but "
                    f"{stored} are there; write it again"
                )
            self._headers[name] = header
        return self._headers[name]

    @staticmethod
    def _skip_header(file: IO[bytes]) -> _Header:
        readers = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        version = np.lib.format.read_magic(file)
        if version not in readers:
            raise ValueError(f"an array of npy version {version}, of which only 1 and 2 hold plain arrays")
        header = _Header(*readers[version](file))
        if header.dtype.hasobject or header.dtype.kind not in _KINDS:
            raise ValueError(f"{header.dtype}, and plain numbers or text are wanted")
        if header.dtype.itemsize == 0 or any(not 0 <= n <= _LARGEST_AXIS for n in header.shape):
            raise ValueError(f"shape {header.shape} of {header.dtype.itemsize} bytes each")
        return header

    @classmethod
    def _rest(cls, file: IO[bytes], header: _Header, source: str) -> np.ndarray:
        """The array behind a header; `source` is what the message calls it where the memory is too small."""
        check_room(header.bytes, f"{source} of shape {header.shape}")
        values = np.empty(math.prod(header.shape), header.dtype)
        cls._fill(file, values)
        if file.read(1):
            raise ValueError("more bytes than its shape says")
        return values.reshape(header.shape, order="F" if header.fortran else "C")

    @staticmethod
    def _fill(file: IO[bytes], values: np.ndarray) -> None:
        """Read the bytes of a flat array."""
        if not values.nbytes:
            return
        target = values.view(np.uint8)
        done = 0
        while done < len(target):
            part = file.read(min(COPY_BYTES, len(target) - done))
            if not part:
                raise EOFError(f"{len(target) - done} bytes are missing")
            target[done : done + len(part)] = np.frombuffer(part, np.uint8)
            done += len(part)

    @contextmanager
    def _member(self, name: str) -> Iterator[IO[bytes]]:
        if name not in self._members:
            raise InputError(f"{self._path}: lacks {name}; it holds {', '.join(self._members) or 'nothing'}")
        try:
            with self._archive.open(self._members[name]) as file:
                yield file
        except InputError:
            raise
        except _FAULTS as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{self._path}: {name} is not a readable plain array ({reason})") from error


@contextmanager
def open_npz(path: Path | str, what: str = "an npz of plain arrays") -> Iterator[Npz]:
    """Open an npz file for reading.

    Args:
        path: the file. what: is wanted, for the message where there is none.

    Raises:
        InputError: no such file, no regular one, or no zip file.
    """
    path = Path(path)
    check_regular(path, what)
    try:
        archive = zipfile.ZipFile(path)
    except _FAULTS as error:
        raise InputError(f"{path}: not a readable npz file ({error}); {what} is wanted") from error
    with archive:
        yield Npz(path, archive)


def read_npz(path: Path | str, what: str = "an npz of plain arrays") -> dict[str, np.ndarray]:
    """All arrays of an npz file, by name.

    Raises:
        InputError: as `open_npz` and `Npz.read`.
    """
    with open_npz(path, what) as npz:
        return {name: npz.read(name) for name in npz.names}


def read_npy(path: Path | str, what: str = "an npy file of one plain array") -> np.ndarray:
    """The array of an npy file.

    Raises:
        InputError: no such file, no regular one, a damaged one, or more than the memory that is free.
    """
    path = Path(path)
    check_regular(path, what)
    try:
        with path.open("rb") as file:
            header = Npz._skip_header(file)
            stored = path.stat().st_size - file.tell()
            if header.bytes != stored:
                raise ValueError(f"{header.bytes} bytes by its header, and {stored} are there")
            return Npz._rest(file, header, f"{path}: an array")
    except InputError:
        raise
    except _FAULTS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not a readable npy array ({reason}); {what} is wanted") from error


def check_room(size: int, source: str) -> None:
    """Raise InputError unless so many bytes of memory are free; `source` is what needs them, for the message."""
    free = available_bytes()
    if free is not None and size > free:
        raise InputError(
            f"{source} needs {size / 2**30:.1f} GiB of memory, and {free / 2**30:.1f} GiB are free"
        )
