"""Whether a result that is one clip npz stands: whole, and made from what it would be made from again."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.data.reader import NpzReader
from imgtransfer.running.fingerprint import recorded
from render import InputError

_TOGETHER = 32  # frames that are read together


def clip_stands(path: Path, fingerprint: str) -> bool:
    """Whether a clip npz has this fingerprint and can be read to its end; not where it is missing or damaged."""
    try:
        reader = NpzReader(path)
        if recorded(reader.clip(0, 1).info) != fingerprint:
            return False
        for _ in reader.parts(_TOGETHER):  # it may be damaged anywhere
            pass
    except InputError:
        return False
    return True
