"""A data set behind fsspec: object storage, a web server, memory."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import fsspec  # type: ignore[import-untyped]
from fsspec.implementations.asyn_wrapper import AsyncFileSystemWrapper  # type: ignore[import-untyped]
from zarr.abc.store import Store
from zarr.storage import FsspecStore

from imgtransfer.data.place import METADATA, group_metadata
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
            filesystem, root = fsspec.url_to_fs(url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            extra = "; pip install 'imgtransfer[remote]'" if isinstance(error, ImportError) else ""
            raise InputError(f"{url}: cannot be reached ({error}){extra}") from error
        return cls(filesystem, url, root.rstrip("/"))

    def _path(self, key: str) -> str:
        return f"{self.root}/{key}" if key else self.root

    def read(self, key: str) -> bytes:
        return self.filesystem.cat_file(self._path(key))

    def read_many(self, keys: Sequence[str]) -> list[bytes]:
        paths = [self._path(key) for key in keys]
        found = self.filesystem.cat(paths) if paths else {}
        return [found[path] for path in paths]

    def write(self, key: str, content: bytes) -> None:
        self._check_writable()
        self.filesystem.pipe_file(self._path(key), content)

    def exists(self, key: str) -> bool:
        try:
            return bool(self.filesystem.isfile(self._path(key)))
        except Exception as error:  # each kind of storage has its own, for credentials, names and networks
            raise InputError(f"{self.url}: cannot be reached ({type(error).__name__}: {error})") from error

    def empty(self) -> bool:
        try:
            return not self.filesystem.ls(self.root, detail=False)
        except FileNotFoundError:
            return True

    def groups(self, depth: int) -> list[str]:
        found = self.filesystem.glob(self._path("*/" * depth + METADATA))
        return sorted("/".join(path.split("/")[-depth - 1 : -1]) for path in found)

    def files(self, folder: str) -> list[str]:
        try:
            entries = self.filesystem.ls(self._path(folder), detail=True)
        except FileNotFoundError:
            return []
        return sorted(entry["name"].rsplit("/", 1)[-1] for entry in entries if entry["type"] == "file")

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
        self._check_writable()
        self.remove(f"{key}/{METADATA}")  # first: from here on there is no such group
        self.remove(key)
        try:
            yield RemotePlace(self.filesystem, f"{self.url}/{key}", self._path(key))
            self.write(f"{key}/{METADATA}", group_metadata(attributes))
        except BaseException:
            self.remove(key)
            raise

    def _check_writable(self) -> None:
        if re.search(r"(^|::)https?:", self.url):
            raise InputError(
                f"{self.url}: web servers can only be read; write to a folder or to object storage"
            )
