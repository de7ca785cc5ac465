"""A data set in a local folder: groups appear whole or not at all, and what dead writers left is removed."""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import Any

from zarr.abc.store import Store
from zarr.storage import LocalStore

from imgtransfer.data.place import METADATA, METADATA_LIMIT, group_metadata
from render import InputError
from render.files import check_regular, written_whole

_YOUNG, _OLD = 60.0, 86400.0  # seconds


@dataclass(frozen=True)
class LocalPlace:
    """A folder. A group is written beside its place and renamed, so that it appears whole or not at all."""

    root: Path

    def read(self, key: str, limit: int = METADATA_LIMIT) -> bytes:
        path = self.root / key
        size = path.stat().st_size  # or OSError
        check_regular(path, "a file of a data set")
        if size > limit:
            raise InputError(f"{path}: {size} bytes, where at most {limit} are wanted; the store is damaged")
        with path.open("rb") as file:
            return file.read(limit)

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
        found = (file.relative_to(self.root).parts[:-1] for file in self.root.glob("*/" * depth + METADATA))
        return sorted("/".join(parts) for parts in found if not any(part.startswith(".") for part in parts))

    def files(self, folder: str) -> list[str]:
        return sorted(
            f.name for f in (self.root / folder).glob("*") if f.is_file() and not f.name.startswith(".")
        )

    def store(self, key: str) -> Store:
        return LocalStore(self.root / key)

    def remove(self, key: str) -> None:
        path = self.root / key
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)

    @contextmanager
    def whole_group(self, key: str, attributes: dict[str, Any]) -> Iterator[LocalPlace]:
        target = self.root / key
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(target.parent)
        temporary = target.parent / f".{target.name}-{os.getpid()}-{time.monotonic_ns()}"
        temporary.mkdir()
        lock = os.open(temporary, os.O_RDONLY)
        try:
            _lock(lock)  # freed when this process dies, however it dies
            yield LocalPlace(temporary)
            (temporary / METADATA).write_bytes(group_metadata(attributes))
            _move_into_place(temporary, target)
        finally:
            os.close(lock)
            shutil.rmtree(temporary, ignore_errors=True)


def remove_abandoned(folder: Path) -> None:
    """Remove what writers that died have left in `folder`: hidden folders that no living process holds."""
    for entry in folder.glob(".*"):
        if entry.is_dir() and _abandoned(entry):
            shutil.rmtree(entry, ignore_errors=True)


def _abandoned(folder: Path) -> bool:
    try:
        age = time.time() - folder.stat().st_mtime
        if age < _YOUNG:  # its writer may not have locked it yet
            return False
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return False  # gone meanwhile
    try:
        return _lock(handle) or age > _OLD
    except BlockingIOError:
        return False
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    """Lock an open folder; False where the file system cannot (NFS). Raises BlockingIOError if another has it."""
    try:
        flock(handle, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def _move_into_place(temporary: Path, target: Path) -> None:
    """Rename a folder, in place of one that stands. Where two processes do so at once, one of them wins."""
    old = temporary.with_name(temporary.name + ".old")
    try:
        if target.exists():
            target.rename(old)
        temporary.rename(target)
    except OSError as error:
        raced = error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT) and temporary.is_dir()
        if not (raced and (target / METADATA).is_file()):
            raise
    finally:
        shutil.rmtree(old, ignore_errors=True)
