"""The log of a training run: one JSON object a line, each with the "step" that it is about."""

from __future__ import annotations

import errno
import json
import logging
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from render.files.atomic import check_regular, errors_naming, written_whole

_log = logging.getLogger(__name__)

LOG_FILE = "log.jsonl"


def read_entries(path: Path) -> tuple[list[dict[str, Any]], int]:
    """The entries of a log in the order of the file, and how many lines are no such entries.

    A run that is killed, or runs out of disk, may leave half a line; that must not cost the others.

    Raises:
        InputError: no regular file.
    """
    check_regular(path, "the log of a training run")
    lines = [line for line in path.read_bytes().splitlines() if line.strip()]
    entries = [entry for line in lines if (entry := _entry(line)) is not None]
    return entries, len(lines) - len(entries)


def _entry(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line.decode())
    except (ValueError, RecursionError):  # not JSON, or not UTF-8
        return None
    step = entry.get("step") if isinstance(entry, dict) else None
    whole = isinstance(step, int | float) and not isinstance(step, bool) and math.isfinite(step)
    return entry if whole else None


@contextmanager
def log_from(path: Path, step: int) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A function that appends an entry to the log of a run that is at `step`.

    What the log holds beyond `step`, of a run that was killed since, is dropped first, and so are lines that cannot be
    read, with a note, and a step's second entry. At step 0 the log begins anew.
    """
    if path.exists():
        _trim(path, step)
    with errors_naming(path):
        file = path.open("ab", buffering=0)  # a line is written in one piece

    def write(entry: dict[str, Any]) -> None:
        line = json.dumps(entry).encode() + b"\n"
        with errors_naming(path):
            if file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with file:
        yield write


def _trim(path: Path, step: int) -> None:
    entries, unreadable = read_entries(path)
    kept = {entry["step"]: entry for entry in reversed(entries) if 0 < step >= entry["step"]}
    if unreadable and step > 0:
        _log.warning("note: %s: %d damaged lines are dropped", path, unreadable)
    with written_whole(path) as temporary:
        temporary.write_text("".join(f"{json.dumps(entry)}\n" for entry in reversed(kept.values())))
