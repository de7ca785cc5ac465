"""Training beside a busy process, by how OpenMP's threads wait for each other; a part of scripts/bench/training.py.

How they wait is read when PyTorch is loaded, so each trainer is a process of its own: this file, run as a program,
does a training step for each line that it reads, and answers each with a line.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.config.loader import load_config
from imgtransfer.running.waiting import CHOSEN_BY
from imgtransfer.training.config import RunConfig
from imgtransfer.training.trainer import Trainer
from scripts.bench.measuring import interleaved

# What OpenMP does if not told otherwise is to spin for a while, which is what a neighbour makes expensive.
POLICIES = {"spinning": {}, "passive": {"OMP_WAIT_POLICY": "PASSIVE"}}
CORES = 2


def measure(config: Path, changes: Sequence[str], rounds: int) -> dict[str, float]:
    """Steps a second on two cores, alone and beside one busy process on the same cores.

    Args:
        config: of the run.
        changes: to it, as `load_config` takes them; its number of threads, too.
        rounds: how often each is timed.
    """
    found: dict[str, float] = {}
    with ExitStack() as stack:
        steps = {
            policy: stack.enter_context(_trainer(variables, config, changes))
            for policy, variables in POLICIES.items()
        }
        for case, company in (("alone", _nothing), ("beside_one", _busy_process)):
            with company():
                times = interleaved({policy: step.__next__ for policy, step in steps.items()}, rounds=rounds)
            found |= {f"steps_per_s_{policy}_{case}": 1 / times.s(policy) for policy in POLICIES}
            found[f"ratio_spinning_to_passive_{case}"] = times.ratio("spinning", "passive")
    return found


@contextmanager
def _trainer(variables: dict[str, str], config: Path, changes: Sequence[str]) -> Iterator[Iterator[str]]:
    """A process with a trainer; each `next` is a step of it."""
    environment = {key: value for key, value in os.environ.items() if key not in CHOSEN_BY} | variables
    with subprocess.Popen(
        [sys.executable, __file__, str(config), *changes],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield _steps(process)
        finally:
            process.stdin.close()  # which ends it


def _steps(process: subprocess.Popen[str]) -> Iterator[str]:
    assert process.stdin is not None
    assert process.stdout is not None
    while True:
        process.stdin.write("step\n")
        answer = process.stdout.readline()
        if not answer:
            raise RuntimeError("the trainer's process has ended; its own message is above")
        yield answer


@contextmanager
def _busy_process() -> Iterator[None]:
    process = multiprocessing.get_context("spawn").Process(target=_spin, daemon=True)
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def _spin() -> None:
    _stay()
    parent = multiprocessing.parent_process()
    assert parent is not None
    while parent.is_alive():  # so that nothing is left where this bench is killed
        pass


@contextmanager
def _nothing() -> Iterator[None]:
    yield


def _stay() -> None:
    """Keep this process on the first cores that it may use, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])


def _serve(config: Path, changes: Sequence[str]) -> None:
    _stay()
    trainer = Trainer(load_config(RunConfig, config, changes))
    for _ in sys.stdin:
        trainer.train_step()
        print("done", flush=True)


if __name__ == "__main__":
    _serve(Path(sys.argv[1]), sys.argv[2:])
