"""Simulate a list of clips over several processes into one data set."""

from __future__ import annotations

import fnmatch
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from imgtransfer.data.clip import Clip
from imgtransfer.data.store import DataSet
from imgtransfer.motions.amass import load_amass
from imgtransfer.motions.motion import Motion, arms_out
from imgtransfer.simulation.config import SimulateConfig, Split
from imgtransfer.simulation.run import Rejected, simulate_clip
from render import InputError


@dataclass(frozen=True, eq=False)
class Task:
    """One clip to simulate."""

    motion: Motion
    split: Split
    config: SimulateConfig

    @property
    def name(self) -> str:
        """Its name in the data set."""
        return f"tshirt/{self.motion.name}"


def plan(config: SimulateConfig, files: Sequence[Path] = (), *, frames: int | None = None) -> list[Task]:
    """The clips that a configuration and motion files (npz, or folders of them) ask for.

    Args:
        frames: keep only so many frames of each.

    Raises:
        InputError: nothing to simulate, two clips of one name, or a motion file that cannot be read.
    """
    tasks = [
        Task(motion, clips.split, config) for clips in config.clips for motion in clips.motions(config.fps)
    ]
    for path in _motion_files(files):
        motion = arms_out(load_amass(path, fps=config.fps), config.files.arms_out)
        split: Split = "train"
        for name, patterns in (("validation", config.files.validation), ("test", config.files.test)):
            if any(fnmatch.fnmatch(motion.name, pattern) for pattern in patterns):
                split = name  # type: ignore[assignment]
        tasks.append(Task(motion, split, config))
    names = [task.name for task in tasks]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"clips {', '.join(twice)} are asked for more than once; give them other seeds or file names"
        )
    if not tasks:
        raise InputError(
            "nothing to simulate: list clips in the configuration, or give motion files or folders"
        )
    if frames is not None:
        tasks = [replace(task, motion=_cut(task.motion, frames)) for task in tasks]
    return tasks


def simulate(tasks: Sequence[Task], out: str | Path, *, workers: int = 1, progress: bool = True) -> list[str]:
    """Simulate every task whose clip the data set at `out` does not hold yet.

    Returns:
        The reasons of the clips that were rejected.

    Raises:
        InputError: `out` is something else than a data set, or every clip was rejected.
    """
    config = tasks[0].config
    store = DataSet.open_or_create(out, title=config.title, licence=config.licence, source=config.source)
    standing = set(store.names())
    left = [task for task in tasks if task.name not in standing]
    reasons: list[str] = []
    with (
        _results(left, workers) as results,
        tqdm(total=len(tasks), initial=len(tasks) - len(left), unit="clip", disable=not progress) as bar,
    ):
        for task, result in results:
            if isinstance(result, str):
                reasons.append(result)
                bar.write(result)
            else:
                store.write(task.name, result, split=task.split)
                bar.write(f"{task.name} ({task.split}): {result.n_frames} frames, {result.info['quality']}")
            bar.update()
    if tasks and len(reasons) == len(tasks):
        raise InputError(f"every clip was rejected; the first: {reasons[0]}")
    return reasons


@contextmanager
def _results(tasks: Sequence[Task], workers: int) -> Iterator[Iterator[tuple[Task, Clip | str]]]:
    """Results as they come; leaving early (Ctrl-C) ends the processes."""
    if workers <= 1 or len(tasks) <= 1:
        yield map(_work, tasks)
        return
    # A fresh interpreter each, because Warp must not be forked; one thread each, because clips are independent.
    threads = {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    os.environ.update(dict.fromkeys(threads, "1"))
    try:
        with _no_interrupts():
            pool = multiprocessing.get_context("spawn").Pool(min(workers, len(tasks)))
        with pool:
            yield pool.imap_unordered(_work, tasks)
    finally:
        for name, value in threads.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Processes that are started in here ignore Ctrl-C, from their first moment on: this process stops them."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals can be set in the main thread only
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _work(task: Task) -> tuple[Task, Clip | str]:
    try:
        return task, simulate_clip(task.motion, task.config)[0]
    except Rejected as reason:
        return task, str(reason)


def _motion_files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        found = sorted(path.glob("*.npz"))
        if not found:
            raise InputError(f"{path}: no npz in this folder; AMASS-style motion files are wanted")
        yield from found


def _cut(motion: Motion, frames: int) -> Motion:
    if frames < 2:
        raise InputError(f"--frames {frames}: at least 2 are wanted")
    return replace(motion, poses=motion.poses[:frames], trans=motion.trans[:frames])
