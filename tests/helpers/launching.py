"""`imgtransfer` in several processes that train together."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil

from tests.helpers.paths import ROOT


def launched(count: int, *words: str, port: int) -> subprocess.Popen[str]:
    """The command `words` in `count` processes, each with one thread."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    launcher = ["-m", "torch.distributed.run", "--nproc_per_node", str(count), "--master_port", str(port)]
    return subprocess.Popen(
        [sys.executable, *launcher, "-m", "imgtransfer.cli.main", *words],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def kill_all(launcher: subprocess.Popen[str]) -> None:
    """SIGKILL to the launcher and to the processes that it has started, which have groups of their own."""
    with suppress(psutil.NoSuchProcess):
        for process in (*psutil.Process(launcher.pid).children(recursive=True), psutil.Process(launcher.pid)):
            with suppress(psutil.NoSuchProcess):
                process.kill()
    launcher.communicate()


def wait_for_entry(launcher: subprocess.Popen[str], log: Path, *, longest_s: float = 180.0) -> bool:
    """Wait until a run writes to its log; False where it ends before, or takes longer."""
    before = _look(log)
    end = time.monotonic() + longest_s
    while time.monotonic() < end and launcher.poll() is None:
        if _look(log) not in (before, (0, 0)):
            return True
        time.sleep(0.05)
    return False


def _look(log: Path) -> tuple[int, int]:
    """When it was written last, and its size; zeros where it is not there."""
    return (log.stat().st_mtime_ns, log.stat().st_size) if log.exists() else (0, 0)
