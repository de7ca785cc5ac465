"""Runs cases in a process that lasts, watches its time and memory, and ends it where it does not answer."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from tests.bad_inputs.case import Case
from tests.helpers.paths import ROOT

# Of work on a case, or of waiting for nothing; and of work on a process's first one, which imports and compiles.
# Waiting for a processor that others have is neither.
SECONDS, FIRST_SECONDS = 20.0, 90.0
_STILL = 10.0  # seconds without work after which a process is taken to wait
_LONGEST = 120.0  # seconds in all, whatever a process does meanwhile
MEMORY = 2 * 2**30  # bytes
_SHOWN = "always::RuntimeWarning,always::UserWarning"  # each time: a process runs many cases


@dataclass(frozen=True)
class Answer:
    """How a command ended.

    Args:
        status: of its exit; None where it was ended.
        out, err: what it printed.
        peak: bytes of memory. seconds: that it took.
        before, after: the files in its folder, with size and time.
        folder: where it ran.
    """

    status: int | None
    out: str
    err: str
    peak: int
    seconds: float
    before: dict[str, tuple[int, int]]
    after: dict[str, tuple[int, int]]
    folder: Path


class Supervisor:
    """Runs cases; a context manager.

    Args:
        good: the folder of the good input. scratch: an empty one for copies.
    """

    def __init__(self, good: Path, scratch: Path) -> None:
        self._good, self._scratch = good, scratch
        self._process: subprocess.Popen[bytes] | None = None
        self._fresh = True

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def run(self, case: Case) -> Answer:
        """Run one case in a folder of its own, which is there until the next one of that name."""
        outer = self._scratch / case.name
        shutil.rmtree(outer, ignore_errors=True)
        folder = outer / "a" / "b"  # so that what climbs out of the folder is found
        folder.mkdir(parents=True)
        for name in _needed(case, self._good):
            _copy(self._good / name, folder / name)
        case.prepare(folder)
        before = files_in(outer)
        started = time.monotonic()
        status, told = self._ask(case, folder)
        seconds = time.monotonic() - started
        err = told.get("err", _text(folder.parent / "err.txt"))
        return Answer(
            status, told.get("out", _text(folder.parent / "out.txt")), err + told.get("ended", ""), told.get("peak", 0),
            seconds, before, files_in(outer), folder,
        )  # fmt: skip

    def _ask(self, case: Case, folder: Path) -> tuple[int | None, dict]:
        if self._process is None:
            self._start()
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{case.name} {folder}\n".encode())
        process.stdin.flush()
        watch = _Watch(process.pid, FIRST_SECONDS if self._fresh else SECONDS)
        while not select.select([process.stdout], [], [], 0.05)[0]:
            why = watch.exceeded()
            if why:
                os.kill(process.pid, signal.SIGUSR1)  # it writes down where it is
                time.sleep(0.3)
                self._end()
                return None, {"ended": f"\nended: {why}", "peak": watch.peak}
        line = process.stdout.readline()
        self._fresh = False
        if not line:
            code = process.wait()
            self._end()
            return None, {"ended": f"\nended: the process died with {code}", "peak": watch.peak}
        told = json.loads(line)
        if _resident(process.pid) > MEMORY / 2:
            self._end()
        return told["status"], told

    def _start(self) -> None:
        paths = [str(ROOT)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONWARNINGS": _SHOWN}
        argv = [sys.executable, "-m", "tests.bad_inputs.worker"]
        self._process = subprocess.Popen(
            argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, cwd="/"
        )
        self._fresh = True

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                pipe.close()
        self._process = None


class _Watch:
    """The time and memory that a process takes from now on."""

    def __init__(self, pid: int, seconds: float) -> None:
        self._pid, self._seconds = pid, seconds
        self._started = self._moved = time.monotonic()
        self._before = self._worked = _processor_seconds(pid)
        self.peak = 0

    def exceeded(self) -> str:
        """Why the process must be ended; "" while it need not."""
        now, worked = time.monotonic(), _processor_seconds(self._pid)
        self.peak = max(self.peak, _resident(self._pid))
        if worked > self._worked + 0.05:
            self._moved, self._worked = now, worked
        if self.peak > 1.5 * MEMORY:
            return f"{self.peak / 2**30:.1f} GiB of memory"
        if worked - self._before > self._seconds:
            return f"no answer after {self._seconds:.0f} s of work"
        if now - self._started > self._seconds and now - self._moved > _STILL:
            return f"no answer and no work for {_STILL:.0f} s"
        if now - self._started > _LONGEST:
            return f"no answer for {_LONGEST:.0f} s"
        return ""


def files_in(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of everything under a folder, by path; links are not followed."""
    found = {}
    for path in sorted(folder.rglob("*")):
        stat = path.lstat()
        found[str(path.relative_to(folder))] = (
            stat.st_size if not path.is_dir() else 0,
            0 if path.is_dir() else stat.st_mtime_ns,
        )
    return found


def _needed(case: Case, good: Path) -> list[str]:
    """Names in the good input that the case's words name, and what it needs besides."""
    first = [word.split("/")[0] for word in case.argv if word]
    return [
        name
        for name in dict.fromkeys((*first, *case.needs))
        if (good / name[:200].replace("\0", "")).exists() and name not in (".", "..")
    ]


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


def _text(path: Path) -> str:
    return path.read_bytes().decode(errors="replace") if path.is_file() else ""


def _processor_seconds(pid: int) -> float:
    """Processor time of a process and of those that it started; the time of day where the system does not say."""
    try:
        return _of_process(pid) + sum(map(_of_child, _children(pid)))
    except OSError:
        return time.monotonic()


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _of_child(pid: int) -> float:
    try:
        return _of_process(pid)
    except OSError:  # it has ended, and counts with the one that started it
        return 0.0


def _of_process(pid: int) -> float:
    """Seconds of all threads, and of processes that it started and that ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def _resident(pid: int) -> int:
    """Bytes of memory that a process holds; 0 where the system does not say."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
