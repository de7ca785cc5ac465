"""`imgtransfer` in several processes that train together."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress

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
