"""Fingerprints of what files hold, whatever they are called: whether a thing was made from these very files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path


def files_fingerprint(files: Iterable[Path]) -> str:
    """A text that changes with the bytes of the files or their order; a file that is missing counts as such."""
    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes() if file.is_file() else None
        digest.update(b"missing" if content is None else b"%d:" % len(content) + content)
    return digest.hexdigest()[:16]
