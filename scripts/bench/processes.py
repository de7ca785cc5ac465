"""Two training processes against one, at the same number of frames a step, with one thread each.

Launched as users do it; the times are those of the runs' own logs, from the second step on. The network and the data
are what `training.py` gives; two processes can be at most twice as fast, where two cores have nothing else to do.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LAUNCHER = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node"]


def measure(config: Path, changes: Sequence[str], steps: int) -> dict[str, float]:
    """Seconds a step by each, and their ratio.

    Args:
        config: of the run, with an even number of frames a batch.
        changes: to it, as `imgtransfer train --set` takes them.
        steps: of each run, at least 3.
    """
    with tempfile.TemporaryDirectory() as folder:
        one = _seconds(config, [*changes, "training.accumulate=2"], steps, Path(folder) / "one", processes=1)
        two = _seconds(config, changes, steps, Path(folder) / "two", processes=2)
    return {"step_s_one_process": one, "step_s_two_processes": two, "ratio_one_to_two_processes": one / two}


def _seconds(config: Path, changes: Sequence[str], steps: int, out: Path, *, processes: int) -> float:
    """Of a step, mean over all but the first."""
    # A run validates after its first and last step.
    settings = [*changes, f"training.steps={steps}", "training.threads=1", "data.validation_frames=2"]
    words = [
        "train",
        str(config),
        "--out",
        str(out),
        *(word for change in settings for word in ("--set", change)),
    ]
    subprocess.run(
        [sys.executable, *LAUNCHER, str(processes), "-m", "imgtransfer.cli.main", *words],
        check=True,
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
    )
    entries = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    # The last step's line comes after a validation.
    timed = {entry["step"]: entry["seconds"] for entry in entries if 1 <= entry["step"] < steps}
    first, last = min(timed), max(timed)
    return (timed[last] - timed[first]) / (last - first)
