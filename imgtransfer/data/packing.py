"""A data set, or some clips of it, as one zip file that is read where it lies."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from imgtransfer.data.place import METADATA
from imgtransfer.data.store import REJECTED, DataSet
from imgtransfer.data.texture_files import STORED
from render import InputError
from render.files.atomic import written_whole

_TOGETHER = 32  # files that are fetched together
_LARGEST_FILE = (1 << 31) + (1 << 26)  # bytes; of a chunk and what its encoding adds
_EARLIEST = (1980, 1, 1, 0, 0, 0)  # the time stamp of every member, so that the same data give the same file


def pack(data: DataSet, target: Path, clips: Sequence[str] | None = None) -> list[str]:
    """Write a data set as one zip file, as Zarr's ZipStore has it: its files as they are, sorted, not compressed again.

    The same files give the same bytes. The file appears whole or not at all.

    Args:
        clips: names of those to take; None takes all of them, with what the data set says of rejected ones.

    Returns:
        The names of the clips that are in it.

    Raises:
        InputError: no such clip, or a file that cannot be read.
    """
    names = data.names() if clips is None else list(clips)
    keys = sorted(_keys(data, names, rejected=clips is None))
    with written_whole(target) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for key, content in _contents(data, keys):
            member = zipfile.ZipInfo(key, _EARLIEST)
            member.create_system, member.external_attr = 3, 0o644 << 16  # of Unix, whatever made it
            archive.writestr(member, content)
    return names


def _keys(data: DataSet, names: Sequence[str], *, rejected: bool) -> set[str]:
    """The files that belong to clips and to the data set; not what writers that died have left."""
    keys = {METADATA}
    textures = [f"{STORED}/{key}" for key in data.place.tree(STORED)]
    for name in names:
        info = data.clip_attributes(name).info
        keys |= {f"{name}/{key}" for key in data.place.tree(name)}
        keys |= {key for key in textures if key in info.get("mtl", "")}
        garment = f"{name.partition('/')[0]}/{METADATA}"
        keys |= {garment} if data.place.exists(garment) else set()
    if rejected:
        keys |= {f"{REJECTED}/{file}" for file in data.place.files(REJECTED)}
    return keys


def _contents(data: DataSet, keys: Sequence[str]) -> Iterator[tuple[str, bytes]]:
    for first in range(0, len(keys), _TOGETHER):
        some = keys[first : first + _TOGETHER]
        for key, content in zip(some, data.place.read_many(some, _LARGEST_FILE), strict=True):
            if content is None:
                raise InputError(f"{data.path}/{key}: gone while it was read; write its clip again")
            yield key, content
