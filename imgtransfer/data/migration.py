"""From older schema versions of the data set to the current one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from imgtransfer.data.place import METADATA, group_metadata
from imgtransfer.data.schema import SCHEMA_VERSION
from imgtransfer.data.store import DataSet
from render import InputError


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
        InputError: no data set, or clips that are damaged; all others are rewritten by then, but the data set counts
            as the older version until those are gone.
    """
    old = DataSet.open(path)
    before = int(old.attributes["schema_version"])
    left = [name for name in old.names() if old.clip_attributes(name).schema_version != SCHEMA_VERSION]
    if left or before != SCHEMA_VERSION:
        old.place.check_writable()
    new = replace(old, attributes=old.attributes | {"schema_version": SCHEMA_VERSION})
    damaged = []
    for name in progress(left):
        try:
            new.write(name, old.read(name), split=old.split(name))
        except InputError as error:
            damaged.append(str(error))
    if damaged:
        raise InputError(
            f"{len(damaged)} of {len(left)} clips are damaged and stay as they are; restore or remove "
            f"them, and migrate again: {'; '.join(damaged)}"
        )
    if before != SCHEMA_VERSION:  # last: until then the data set counts as the older version
        new.place.write(METADATA, group_metadata(new.attributes))
    return left, before
