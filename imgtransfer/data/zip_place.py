"""A data set that is one zip file, as Zarr's ZipStore writes it: read like a folder, never written to."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, NoReturn

from zarr.abc.store import Store

from imgtransfer.data.archive import Member, RangedFile, members, read_members
from imgtransfer.data.place import METADATA, METADATA_LIMIT, Place
from render import InputError

ENDING = ".zip"


@dataclass(frozen=True)
class ZipPlace:
    """The members of a zip file as a place; only those that are asked for are read."""

    file: RangedFile

    @property
    def folder(self) -> None:
        return None

    @property
    def _members(self) -> dict[str, Member]:
        """By key; none where there is no file."""
        try:
            return members(self.file)
        except FileNotFoundError:
            return {}

    def read(self, key: str, limit: int = METADATA_LIMIT) -> bytes:
        (content,) = self.read_many([key], limit)
        if content is None:
            raise FileNotFoundError(f"{self.file.where}/{key}")
        return content

    def read_many(self, keys: Sequence[str], limit: int = METADATA_LIMIT) -> list[bytes | None]:
        present = self._members
        wanted = [present[key] for key in keys if key in present]
        contents = iter(read_members(self.file, wanted, limit))
        return [next(contents) if key in present else None for key in keys]

    def exists(self, key: str) -> bool:
        return key in self._members

    def empty(self) -> bool:
        try:
            self.file.state()
        except FileNotFoundError:
            return True
        return False

    def groups(self, depth: int) -> list[str]:
        split = [key.split("/") for key in self._members]
        return sorted(
            "/".join(parts[:-1])
            for parts in split
            if len(parts) == depth + 1 and parts[-1] == METADATA and not any(p.startswith(".") for p in parts)
        )

    def files(self, folder: str) -> list[str]:
        return [key for key in self.tree(folder) if "/" not in key]

    def tree(self, folder: str) -> list[str]:
        inside = [key.removeprefix(f"{folder}/") for key in self._members if key.startswith(f"{folder}/")]
        return sorted(key for key in inside if not any(part.startswith(".") for part in key.split("/")))

    def check_writable(self) -> NoReturn:
        name = self.file.where.partition("?")[0].rpartition("/")[2]
        folder = name[: -len(ENDING)] if name.lower().endswith(ENDING) else f"{name}.zarr"
        command = f"python -m zipfile -e {shlex.quote(name)} {shlex.quote(folder)}"
        raise InputError(
            f"{self.file.where}: a data set in one zip file is only read; give a folder to write to, "
            f"or unpack the file into one, where it lies, by: {command}"
        )

    def write(self, key: str, content: bytes) -> None:
        self.check_writable()

    def store(self, key: str) -> Store:
        self.check_writable()

    def remove(self, key: str) -> None:
        self.check_writable()

    def put_back(self) -> None:
        """Nothing is ever moved aside here."""

    def whole_group(self, key: str, attributes: dict[str, Any]) -> AbstractContextManager[Place]:
        self.check_writable()
