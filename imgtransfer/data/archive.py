"""The members of a zip file, each read alone from a file of which any part can be had, and checked before use."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

from render import InputError

Span = tuple[int, int]  # first byte, last byte + 1

_TAIL = 1 << 16  # bytes at the end that are fetched first; the directory of a small file is among them
_LONGEST_READ = 1 << 26  # bytes; a directory of half a million members
_HEADER = 30  # bytes before a member's name
_LONGEST_FIELD = 1 << 16  # bytes; of a name, of what is added to it
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class RangedFile(Protocol):
    """A file of which any part can be read, on this machine or elsewhere.

    Its methods raise FileNotFoundError where there is none, InputError where it cannot be had.
    """

    @property
    def where(self) -> str:
        """Its path or URL."""
        ...

    def state(self) -> tuple[int, Hashable]:
        """Its size in bytes, and what is another value when its content is another."""
        ...

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        """The bytes of each span, fetched at once where that is faster; as many as were asked for."""
        ...


@dataclass(frozen=True)
class Member:
    """What the directory says of a member, as far as it can be true.

    Args:
        record: where its header and content lie. compressed, size: of its content, in bytes.
        deflated: whether the content is compressed. crc: its checksum.
        encoding: of its name in the header.
    """

    name: str
    record: Span
    compressed: int
    size: int
    deflated: bool
    crc: int
    encoding: str


def members(file: RangedFile) -> dict[str, Member]:
    """The members of a zip file by their names, folders left out. The directories read last are kept.

    Raises:
        FileNotFoundError: there is no file.
        InputError: it is no zip file, is cut short, or has members that no data set has: encrypted, compressed in other
            ways than by deflating, of one name, with names that mean places outside, or in each other's bytes.
    """
    size, version = file.state()
    return _members(_Opened(file.where, size, version, file))


def read_members(file: RangedFile, wanted: Sequence[Member], limit: int) -> list[bytes]:
    """The contents of members, none of them larger than `limit` bytes.

    Raises:
        InputError: a member that is larger, or damaged; the message names it.
    """
    for member in wanted:
        if member.size > limit:
            raise InputError(
                f"{file.where}/{member.name}: {member.size} bytes, where at most {limit} are wanted; "
                "the file is damaged"
            )
    records = file.read([member.record for member in wanted])
    return [_content(file, member, record) for member, record in zip(wanted, records, strict=True)]


@dataclass(frozen=True)
class _Opened:
    """A file in one of its states."""

    where: str
    size: int
    version: Hashable
    file: RangedFile = field(compare=False)


@lru_cache(maxsize=8)
def _members(opened: _Opened) -> dict[str, Member]:
    where = opened.where
    try:
        archive = zipfile.ZipFile(_Directory(opened.file, opened.size))
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OverflowError, struct.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{where}: not a zip file, or one that was cut short ({error}); get or make it again"
        ) from error
    infos = sorted(archive.infolist(), key=lambda info: info.header_offset)
    starts = [*(info.header_offset for info in infos), archive.start_dir]
    listed: dict[str, Member] = {}
    for info, end in zip(infos, starts[1:], strict=True):
        reason = _refusal(info, end) or ("is there twice" if info.filename in listed else None)
        if reason is not None:
            raise InputError(f"{where}: member {info.orig_filename!r} {reason}; make the file again")
        if not info.is_dir():
            # The header's own fields are only known when it has been read.
            longest = _HEADER + 2 * _LONGEST_FIELD + info.compress_size
            listed[info.filename] = Member(
                name=info.filename,
                record=(info.header_offset, min(end, info.header_offset + longest)),
                compressed=info.compress_size,
                size=info.file_size,
                deflated=info.compress_type == zipfile.ZIP_DEFLATED,
                crc=info.CRC,
                encoding="utf-8" if info.flag_bits & 0x800 else "cp437",
            )
    return listed


def _refusal(info: zipfile.ZipInfo, end: int) -> str | None:
    """Why no data set has such a member, whose bytes end at `end` at the latest; None where it may."""
    name, size, stored = info.orig_filename, info.file_size, info.compress_type == zipfile.ZIP_STORED
    most = size if stored else size + size // 1000 + 64  # what does not compress grows a little
    refusals = {
        "has a name that is none": name != info.filename or "\\" in name or not name.isprintable(),
        "has a name that means a place outside": any(
            part in ("", ".", "..") for part in name.removesuffix("/").split("/")
        ),
        "is encrypted": info.flag_bits & 1,
        "is compressed in a way that is not read": info.compress_type not in _METHODS,
        f"has {info.compress_size} bytes for {size}": not (size if stored else 0)
        <= info.compress_size
        <= most,
        "lies outside the file or over another one": not 0
        <= info.header_offset
        <= end - _HEADER - info.compress_size,
    }
    return next((reason for reason, applies in refusals.items() if applies), None)


def _content(file: RangedFile, member: Member, record: bytes) -> bytes:
    """The checked content of a member."""
    damaged = InputError(
        f"{file.where}/{member.name}: damaged, its checksum or header is not that of the directory; "
        "get the file again"
    )
    if len(record) < _HEADER or record[:4] != zipfile.stringFileHeader:  # type: ignore[attr-defined]
        raise damaged
    length, added = struct.unpack("<HH", record[26:_HEADER])
    name, start = record[_HEADER : _HEADER + length], _HEADER + length + added
    content = record[start : start + member.compressed]
    if name.decode(member.encoding, "replace") != member.name or len(content) != member.compressed:
        raise damaged
    if member.deflated:
        try:
            content = zlib.decompressobj(-zlib.MAX_WBITS).decompress(content, member.size + 1)
        except zlib.error:
            raise damaged from None
    if len(content) != member.size or zlib.crc32(content) != member.crc:
        raise damaged
    return content


class _Directory:
    """A file as `zipfile` reads the directory from its end: in few and not too large parts."""

    def __init__(self, file: RangedFile, size: int) -> None:
        self._file, self._size, self._at = file, size, 0
        self._start = max(0, size - _TAIL)
        (self._tail,) = file.read([(self._start, size)]) if size else (b"",)

    def seek(self, offset: int, whence: int = 0) -> int:
        at = offset + (0, self._at, self._size)[whence]
        if at < 0:
            raise OSError("before the start")  # as of files, which `zipfile` expects
        self._at = at
        return at

    def tell(self) -> int:
        return self._at

    def read(self, count: int = -1) -> bytes:
        end = self._size if count < 0 else min(self._size, self._at + count)
        start, self._at = self._at, max(self._at, end)
        if start >= end:
            return b""
        if start >= self._start:
            return self._tail[start - self._start : end - self._start]
        if end - start > _LONGEST_READ:
            raise ValueError(f"a directory of {end - start} bytes")
        return self._file.read([(start, end)])[0]
