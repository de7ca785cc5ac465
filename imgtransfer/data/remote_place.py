"""A data set behind fsspec: object storage, a web server, memory."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import fsspec  # type: ignore[import-untyped]
from fsspec.implementations.asyn_wrapper import AsyncFileSystemWrapper  # type: ignore[import-untyped]
from zarr.abc.store import Store
from zarr.storage import FsspecStore

from imgtransfer.data.place import METADATA, METADATA_LIMIT, group_metadata
from render import InputError


@dataclass(frozen=True)
class RemotePlace:
    """A place behind fsspec. There is no renaming in object storage, so a group's metadata is written last, in
    one piece: without it there is no group, and what an interrupted write left is removed by the next. So a clip that
    is being replaced is lost should the writer be killed; on a local disk it is not.
    """

    filesystem: fsspec.AbstractFileSystem
    url: str
    root: str  # what `filesystem` calls the URL

    @classmethod
    def at(cls, url: str) -> RemotePlace:
        """The place of a URL.

        Raises:
            InputError: a URL of a kind that fsspec does not know, or whose package is missing.
        """
        try:
            if _is_web(url):
                _read_web_servers_with_limits()
            filesystem, root = fsspec.url_to_fs(url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            extra = "; pip install 'imgtransfer[remote]'" if isinstance(error, ImportError) else ""
            raise InputError(f"{url}: cannot be reached ({error}){extra}") from error
        return cls(filesystem, url, root.rstrip("/"))

    @property
    def folder(self) -> None:
        return None

    def _path(self, key: str) -> str:
        return f"{self.root}/{key}" if key else self.root

    @contextmanager
    def reached(self, key: str = "") -> Iterator[None]:
        """What goes wrong within is an InputError with the true reason, except that a file is not there."""
        try:
            yield
        except (FileNotFoundError, InputError):
            raise
        except Exception as error:  # each kind of storage has its own, for credentials, names and networks
            where = f"{self.url}/{key}" if key else self.url
            raise InputError(f"{where}: cannot be read ({self._reason(error)})") from error

    def _reason(self, error: Exception) -> str:
        if _is_web(self.url):
            from imgtransfer.data.http_files import reason  # noqa: PLC0415

            return reason(error)
        return f"{type(error).__name__}: {' '.join(str(error).split())}"

    def read(self, key: str, limit: int = METADATA_LIMIT) -> bytes:
        (content,) = self.read_many([key], limit)
        if content is None:
            raise FileNotFoundError(f"{self.url}/{key}")
        return content

    def read_many(self, keys: Sequence[str], limit: int = METADATA_LIMIT) -> list[bytes | None]:
        paths = [self._path(key) for key in keys]
        limited = {"limit": limit} if self.url.startswith("http") else {}
        contents: dict[str, bytes | Exception] = {}
        if paths:
            with self.reached():
                contents = self.filesystem.cat(paths, on_error="return", **limited)
        return [self._content(key, contents[path], limit) for key, path in zip(keys, paths, strict=True)]

    def _content(self, key: str, content: bytes | Exception, limit: int) -> bytes | None:
        with self.reached(key):
            if isinstance(content, FileNotFoundError):
                return None
            if isinstance(content, Exception):
                raise content
        if len(content) > limit:
            raise InputError(f"{self.url}/{key}: {len(content)} bytes, where at most {limit} are wanted")
        return content

    def write(self, key: str, content: bytes) -> None:
        self.check_writable()
        with self.reached(key):
            self.filesystem.pipe_file(self._path(key), content)

    def exists(self, key: str) -> bool:
        with self.reached(key):
            return bool(self.filesystem.isfile(self._path(key)))

    def empty(self) -> bool:
        return not self._listing("")

    def groups(self, depth: int) -> list[str]:
        with self.reached():
            paths = self.filesystem.glob(self._path("*/" * depth + METADATA))
        return sorted("/".join(path.split("/")[-depth - 1 : -1]) for path in paths)

    def files(self, folder: str) -> list[str]:
        entries = self._listing(folder)
        return sorted(entry["name"].rsplit("/", 1)[-1] for entry in entries if entry["type"] == "file")

    def _listing(self, folder: str) -> list[dict[str, Any]]:
        try:
            with self.reached(folder):
                return self.filesystem.ls(self._path(folder), detail=True)
        except FileNotFoundError:
            return []

    def tree(self, folder: str) -> list[str]:
        try:
            with self.reached(folder):
                paths = self.filesystem.find(self._path(folder))
        except FileNotFoundError:
            return []
        keys = (path.partition(f"{self._path(folder)}/")[2] for path in paths)
        return sorted(key for key in keys if key and not any(part.startswith(".") for part in key.split("/")))

    def store(self, key: str) -> Store:
        # In threads rather than on Zarr's event loop, on which chains such as simplecache::https:// do not work.
        filesystem = AsyncFileSystemWrapper(self.filesystem, asynchronous=True)
        return FsspecStore(filesystem, path=self._path(key))

    def remove(self, key: str) -> None:
        if self.filesystem.exists(self._path(key)):
            self.filesystem.rm(self._path(key), recursive=True)

    def put_back(self) -> None:
        """Nothing is ever moved aside here."""

    @contextmanager
    def whole_group(self, key: str, attributes: dict[str, Any]) -> Iterator[RemotePlace]:
        self.check_writable()
        self.remove(f"{key}/{METADATA}")  # first: from here on there is no such group
        self.remove(key)
        try:
            yield RemotePlace(self.filesystem, f"{self.url}/{key}", self._path(key))
            self.write(f"{key}/{METADATA}", group_metadata(attributes))
        except BaseException:
            self.remove(key)
            raise

    def check_writable(self) -> None:
        if _is_web(self.url):
            raise InputError(
                f"{self.url}: web servers can only be read; write to a folder or to object storage"
            )


@dataclass(frozen=True)
class RemoteFile:
    """A file behind fsspec of which parts are fetched.

    Args:
        place: what its URL names, as if it were a folder.
    """

    place: RemotePlace

    @property
    def where(self) -> str:
        return self.place.url

    def state(self) -> tuple[int, Hashable]:
        # First: of a server that refuses, `info` says that there is no such file.
        if not self.place.exists(""):
            raise FileNotFoundError(self.where)
        with self.place.reached():
            info = self.place.filesystem.info(self.place.root)
        if not isinstance(size := info.get("size"), int):
            raise InputError(f"{self.where}: cannot be read (the server does not say how large the file is)")
        return size, str(sorted(info.items()))

    def read(self, spans: Sequence[tuple[int, int]]) -> list[bytes]:
        starts, stops = [start for start, _ in spans], [stop for _, stop in spans]
        with self.place.reached():
            parts = self.place.filesystem.cat_ranges(
                [self.place.root] * len(spans), starts, stops, on_error="raise"
            )
        for part, (start, stop) in zip(parts, spans, strict=True):
            if len(part) != stop - start:
                raise InputError(
                    f"{self.where}: cannot be read ({len(part)} bytes came where {stop - start} were asked for)"
                )
        return list(parts)


def _is_web(url: str) -> bool:
    return re.search(r"(^|::)https?:", url) is not None


def _read_web_servers_with_limits() -> None:
    """Have fsspec use `HttpFiles`, also within chains such as simplecache::https://.

    Raises:
        ImportError: the extra `remote` is missing.
    """
    from imgtransfer.data.http_files import HttpFiles  # noqa: PLC0415

    for scheme in ("http", "https"):
        fsspec.register_implementation(scheme, HttpFiles, clobber=True)
