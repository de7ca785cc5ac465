"""Tasks for the tests of the runner: importable by other processes."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from render import InputError
from render.files.atomic import written_whole


@dataclass(frozen=True)
class Task:
    """A number to square, and what is to happen on the way."""

    number: int
    folder: Path
    deaths: int = 0  # how often its process is killed before it succeeds
    fault: str = ""  # "input" or "bug"
    seconds: float = 0.0

    @property
    def name(self) -> str:
        return f"task {self.number}"


def square(task: Task) -> int:
    """The square, after the task's mishaps; every start leaves a file."""
    starts = len(list(task.folder.glob(f"{task.number}-*")))
    (task.folder / f"{task.number}-{starts}-{os.getpid()}").touch()
    time.sleep(task.seconds)
    if starts < task.deaths:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.fault == "input":
        raise InputError(f"{task.number} is no good")
    if task.fault == "bug":
        raise ZeroDivisionError("a bug")
    return task.number**2


def square_into_file(task: Task) -> None:
    """`square`, written to a file that appears whole or not at all."""
    with written_whole(task.folder / f"{task.number}.result") as temporary:
        temporary.write_text(str(square(task)))


def threads(task: Task) -> str:
    """How many threads the process may use, and how they wait."""
    return f"{os.environ['OMP_NUM_THREADS']} {os.environ['OMP_WAIT_POLICY']}"


def unpicklable(task: Task) -> object:
    """A result that cannot be sent."""
    return lambda: None
