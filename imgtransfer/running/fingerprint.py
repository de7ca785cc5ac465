"""The one rule for what is done already: a result keeps, under `MADE` in its `info`, the fingerprint of what it was
made from, files and settings; a task whose fingerprint is the same leaves the result as it is.

Names and times count for nothing where contents can be read in the time that comparing them would take.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

MADE = "made"  # key of a clip's `info`
_EARLIER = "imported"  # the key that imports wrote before they had the common one
_BLOCK = 2**20  # bytes of a file that are read together


def fingerprint(parts: Iterable[str | bytes | memoryview]) -> str:
    """A text that changes with the parts or their order; an array is given as the `data` of its rows."""
    digest = hashlib.sha256()
    for number, part in enumerate(parts):
        if number > 0:
            digest.update(b"|")
        digest.update(part.encode() if isinstance(part, str) else part)
    return digest.hexdigest()[:16]


def files_fingerprint(files: Iterable[Path]) -> str:
    """A text that changes with the bytes of the files or their order; a file that is missing counts as such."""
    digest = hashlib.sha256()
    for file in files:
        if not file.is_file():
            digest.update(b"missing")
            continue
        with file.open("rb") as content:
            digest.update(b"%d:" % file.stat().st_size)
            while block := content.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()[:16]


def recorded(info: Mapping[str, str]) -> str | None:
    """The fingerprint of what a clip was made from, out of its `info`; None where that does not say."""
    return info.get(MADE, info.get(_EARLIER))


def made_anew(info: Mapping[str, str]) -> dict[str, str]:
    """A clip's `info` for another clip that is made from it: without the fingerprint, which would not be its own."""
    return {key: text for key, text in info.items() if key not in (MADE, _EARLIER)}
