"""What a data set needs of the storage that it lies in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from zarr.abc.store import Store

METADATA = "zarr.json"  # of a group; a clip stands once this file of its group does
METADATA_LIMIT = 16 << 20  # bytes


class Place(Protocol):
    """What a data set needs of its storage; keys are paths below its root, separated by "/"."""

    @property
    def folder(self) -> Path | None:
        """Where its files are, for programs that want paths; None where they are not on this machine."""
        ...

    def read(self, key: str, limit: int = METADATA_LIMIT) -> bytes:
        """The content of a file. Raises OSError where there is none, InputError where it cannot be had (see below)."""
        ...

    def read_many(self, keys: Sequence[str], limit: int = METADATA_LIMIT) -> list[bytes | None]:
        """The contents of files, fetched at once where that is faster; None for a file that is missing.

        Raises:
            InputError: what is there is no regular file, or larger than `limit` bytes; or a server that refuses,
                sends something else than it says, or does not answer in time. The message names the file.
        """
        ...

    def write(self, key: str, content: bytes) -> None:
        """Write a file whole or not at all, in place of an earlier one."""
        ...

    def exists(self, key: str) -> bool:
        """Whether there is such a file."""
        ...

    def empty(self) -> bool:
        """Whether nothing stands here yet (files under way, whose names start with a dot, do not count)."""
        ...

    def groups(self, depth: int) -> list[str]:
        """Keys of the folders `depth` levels below the root that hold a group's metadata, sorted."""
        ...

    def files(self, folder: str) -> list[str]:
        """Names of the files right in a folder, sorted; none where it does not exist."""
        ...

    def tree(self, folder: str) -> list[str]:
        """Keys of all files below a folder, relative to it, sorted; those under way are left out, see `empty`."""
        ...

    def check_writable(self) -> None:
        """Raise InputError, which says where to write instead, where nothing can be written here."""
        ...

    def store(self, key: str) -> Store:
        """The Zarr store rooted at a folder, to write to."""
        ...

    def remove(self, key: str) -> None:
        """Remove a file or folder, if it exists."""
        ...

    def put_back(self) -> None:
        """Give groups two levels below the root their names back that a writer which died had moved aside."""
        ...

    def whole_group(self, key: str, attributes: dict[str, Any]) -> AbstractContextManager[Place]:
        """Yield a `Place` to write a group's arrays to. The group stands once it is left without an error, in place
        of an earlier one; after an error nothing of it is left.
        """
        ...


def group_metadata(attributes: dict[str, Any]) -> bytes:
    """The metadata file of a Zarr v3 group with these attributes."""
    metadata = {"attributes": attributes, "zarr_format": 3, "node_type": "group"}
    return (json.dumps(metadata, indent=2) + "\n").encode()
