"""Whether a disk has room, asked before libraries write that end the process or leave half a file where it has none."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

_TAIL = 1 << 16  # bytes that formats write at the end, beside what is counted


def check_room(file: Path, count: int) -> None:
    """Raise the system's OSError unless `file` can become `count` bytes longer, and a little more for its end.

    A hidden file beside it is written so far: a disk's free space does not tell of quotas and limits.
    """
    with TemporaryFile(dir=file.parent) as probe:
        probe.seek(file.stat().st_size)
        left = count + _TAIL
        while left > 0:
            left -= probe.write(bytes(min(left, 1 << 22)))
        probe.flush()
