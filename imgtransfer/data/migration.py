"""From older schema versions of the data set to the current one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from imgtransfer.data.place import METADATA, group_metadata
from imgtransfer.data.schema import SCHEMA_VERSION
from imgtransfer.data.store import DataSet


def migrate(path: str | Path, progress: Callable[[list[str]], Iterable[str]] = iter) -> tuple[list[str], int]:
    """Rewrite a data set of version 1 in place, clip by clip; what was stopped goes on where it was.

    Version 2 stores every chunk, with a checksum, so that lost and damaged ones are noticed, and positions so that any
    32 frames can be read without those before them. Arrays keep their values bit for bit.

    Args:
        path: folder or URL of the data set.
        progress: wraps the names of the clips to rewrite, such as tqdm.

    Returns:
        The clips that were rewritten, and the version that the data set had.

    Raises:
        InputError: no data set, or a clip that is damaged (those before it are rewritten by then).
    """
    old = DataSet.open(path)
    before = int(old.attributes["schema_version"])
    left = [name for name in old.names() if old.clip_attributes(name).schema_version != SCHEMA_VERSION]
    new = replace(old, attributes=old.attributes | {"schema_version": SCHEMA_VERSION})
    for name in progress(left):
        new.write(name, old.read(name), split=old.split(name))
    if before != SCHEMA_VERSION:  # last: until then the data set counts as the older version
        new.place.write(METADATA, group_metadata(new.attributes))
    return left, before
