"""A data set in a local folder: groups appear whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from zarr.abc.store import Store
from zarr.storage import LocalStore

from imgtransfer.data.place import METADATA, METADATA_LIMIT, group_metadata
from render import InputError
from render.files.atomic import check_regular, written_whole, written_whole_folder
from render.files.temporaries import clear_all, put_back


@dataclass(frozen=True)
class LocalFile:
    """A file of which parts are read. It is opened for each reading: forked processes would share a position in it."""

    path: Path

    @property
    def where(self) -> str:
        return str(self.path)

    def state(self) -> tuple[int, Hashable]:
        status = self.path.stat()  # or FileNotFoundError
        check_regular(self.path, "a data set in one zip file")
        return status.st_size, (status.st_mtime_ns, status.st_ino)

    def read(self, spans: Sequence[tuple[int, int]]) -> list[bytes]:
        with self.path.open("rb") as file:
            return [self._part(file, start, stop) for start, stop in spans]

    def _part(self, file: BinaryIO, start: int, stop: int) -> bytes:
        file.seek(start)
        part = file.read(stop - start)
        if len(part) != stop - start:
            raise InputError(f"{self.path}: shorter than it was; read it when it is whole")
        return part


@dataclass(frozen=True)
class LocalPlace:
    """A folder. A group is written beside its place and swapped for an earlier one, see `render.files.temporaries`."""

    root: Path

    @property
    def folder(self) -> Path:
        return self.root

    def read(self, key: str, limit: int = METADATA_LIMIT) -> bytes:
        path = self.root / key
        size = path.stat().st_size  # or OSError
        check_regular(path, "a file of a data set")
        if size > limit:
            raise InputError(f"{path}: {size} bytes, where at most {limit} are wanted; the store is damaged")
        with path.open("rb") as file:
            return file.read(size)  # not `limit`, of which Python would set so much memory aside

    def read_many(self, keys: Sequence[str], limit: int = METADATA_LIMIT) -> list[bytes | None]:
        return [self._read_if_there(key, limit) for key in keys]

    def _read_if_there(self, key: str, limit: int) -> bytes | None:
        try:
            return self.read(key, limit)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write(self, key: str, content: bytes) -> None:
        with written_whole(self.root / key) as temporary:
            temporary.write_bytes(content)

    def exists(self, key: str) -> bool:
        return (self.root / key).is_file()

    def empty(self) -> bool:
        if not self.root.exists():
            return True
        return self.root.is_dir() and all(entry.name.startswith(".") for entry in self.root.iterdir())

    def groups(self, depth: int) -> list[str]:
        parents = (file.relative_to(self.root).parts[:-1] for file in self.root.glob("*/" * depth + METADATA))
        return sorted("/".join(parts) for parts in parents if not any(part.startswith(".") for part in parts))

    def files(self, folder: str) -> list[str]:
        return sorted(
            f.name for f in (self.root / folder).glob("*") if f.is_file() and not f.name.startswith(".")
        )

    def tree(self, folder: str) -> list[str]:
        root = self.root / folder
        keys = (file.relative_to(root).as_posix() for file in root.rglob("*") if file.is_file())
        return sorted(key for key in keys if not any(part.startswith(".") for part in key.split("/")))

    def check_writable(self) -> None:
        """A folder may be written to; what the system forbids it says itself."""

    def store(self, key: str) -> Store:
        return LocalStore(self.root / key)

    def remove(self, key: str) -> None:
        path = self.root / key
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)

    def put_back(self) -> None:
        for folder in self.root.glob("[!.]*/"):
            put_back(folder, holding=METADATA)

    @contextmanager
    def whole_group(self, key: str, attributes: dict[str, Any]) -> Iterator[LocalPlace]:
        target = self.root / key
        clear_all(target.parent)
        with written_whole_folder(target) as temporary:
            yield LocalPlace(temporary)
            (temporary / METADATA).write_bytes(group_metadata(attributes))
