"""Simulate a list of clips into one data set, each as a task of its own."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from imgtransfer.data.location import everywhere, place_at
from imgtransfer.data.metadata import read_clips
from imgtransfer.data.store import DataSet
from imgtransfer.running import Executor, Serial, run_tasks
from imgtransfer.running.fingerprint import MADE, recorded
from imgtransfer.simulation.planning.task import Task
from imgtransfer.simulation.run import Rejected, simulate_clip
from render import InputError, Option

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Job:
    """A task and where its clip goes."""

    task: Task
    out: str | Path

    @property
    def name(self) -> str:
        return self.task.name


@dataclass(frozen=True)
class _Made:
    """What came of a task: a line about it, and why the clip was rejected, if it was."""

    line: str
    rejected: str | None = None


def simulate(
    tasks: Sequence[Task], out: str | Path, *, executor: Executor | None = None, progress: bool = True
) -> dict[str, str]:
    """Simulate every task whose clip the data set at `out` neither holds yet nor lists as rejected.

    Each clip is written by the process that made it, whole or not at all; what was stopped, or failed, is done by the
    next call. A rejected clip is listed in the data set, and made again only under other settings; so is one whose
    garment was drawn at random and cannot be made on its body.

    Args:
        out: folder or URL of the data set, made with the first clip; for a cluster one that all machines see.
        executor: where the tasks are done; None does them in this process.
        progress: whether to print lines and show a bar.

    Returns:
        By name, the reasons of the clips that were rejected, now or before.

    Raises:
        InputError: `out` is something else than a data set, tasks failed for other reasons than the gates (all others
            are done by then), or every clip was rejected.
    """
    out = everywhere(out)
    there, rejected = standing(tasks, out)
    jobs = [_Job(task, out) for task in tasks if task.name not in there | rejected.keys()]
    run = run_tasks(
        _make,
        jobs,
        executor=executor or Serial(),
        name=lambda job: job.name,
        say=lambda made: made.line,
        progress=progress,
    )
    rejected |= {name: made.rejected for name, made in run.values.items() if made.rejected is not None}
    run.check()
    if tasks and len(rejected) == len(tasks):
        first = rejected[tasks[0].name]
        raise InputError(
            f"every clip was rejected, {out} lists the reasons and holds no clip of these; the first: {first}"
        )
    return rejected


def standing(tasks: Sequence[Task], out: str | Path) -> tuple[set[str], dict[str, str]]:
    """Names of the clips that `out` holds, and of the tasks' those that it lists as rejected, with the reasons."""
    place = place_at(out)
    place.check_writable()
    if place.empty():
        return set(), {}
    data = DataSet.open(out)
    listed = data.rejected()
    rejected = {
        task.name: listed[task.name]["reason"]
        for task in tasks
        if task.name in listed and listed[task.name]["made"] == task.fingerprint()
    }
    names = set(data.names())
    _note_others(tasks, data, names)
    return names, rejected


def _note_others(tasks: Sequence[Task], data: DataSet, names: set[str]) -> None:
    """Say which clips stand that were made from other files or settings: they stay as they are."""
    there = [task for task in tasks if task.name in names]
    attributes = read_clips(data.place, [task.name for task in there], str(data.path))
    records = [recorded(its.info) for its in attributes]
    others = [
        task.name for task, made in zip(there, records, strict=True) if made and made != task.fingerprint()
    ]
    if others:
        some = ", ".join(others[:3]) + (" ..." if len(others) > 3 else "")
        _log.warning(
            "note: %d clips stand that were made with other settings or files and are left as they are (%s); to make "
            "them anew, give another %s, or remove them from %s",
            len(others),
            some,
            Option("out"),
            data.path,
        )


def _make(job: _Job) -> _Made:
    """Simulate one clip and write it."""
    task, config = job.task, job.task.config
    data = DataSet.open_or_create(job.out, title=config.title, licence=config.licence, source=config.source)
    if data.has(task.name):  # the process that made it died between writing and saying so
        return _Made(f"{task.name}: stands")
    try:
        clip = simulate_clip(task.motion, config)[0]
    except InputError as error:
        if not (task.drawn or isinstance(error, Rejected)):
            raise
        reason = str(error) if isinstance(error, Rejected) else f"{task.name}: left out: {error}"
        data.reject(task.name, reason, task.fingerprint())
        return _Made(reason, rejected=reason)
    made = replace(clip, info=clip.info | {MADE: task.fingerprint()})
    data.write(task.name, made, split=task.split)
    return _Made(f"{task.name} ({task.split}): {clip.n_frames} frames, {clip.info['quality']}")
