"""The log of a training run: one JSON object a line, each with the "step" that it is about."""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from imgtransfer.report.logs import read_entries
from render.files.atomic import errors_naming, written_whole

_log = logging.getLogger(__name__)

LOG_FILE = "log.jsonl"


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
