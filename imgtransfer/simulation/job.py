"""Simulate a list of clips into one data set: what is asked for, and each clip as a task of its own."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from imgtransfer.data.place import everywhere, place_at
from imgtransfer.data.store import DataSet
from imgtransfer.motions.check import motion_faults
from imgtransfer.motions.files import load_motion, motion_files
from imgtransfer.motions.motion import Motion, arms_out
from imgtransfer.running import Executor, Serial, run_tasks
from imgtransfer.simulation.config import SimulateConfig, Split
from imgtransfer.simulation.run import Rejected, clip_name, simulate_clip
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
        return clip_name(self.config, self.motion)


def plan(config: SimulateConfig, files: Sequence[Path] = (), *, frames: int | None = None) -> list[Task]:
    """The clips that a configuration and motion files (npz, bvh, or folders of them) ask for.

    A motion file in which a joint turns too far or too fast for a body is left out, and named on stderr.

    Args:
        frames: keep only so many frames of each.

    Raises:
        InputError: nothing to simulate, two clips of one name, or a motion file that cannot be read.
    """
    motions: list[tuple[Motion, Split]] = [
        (motion, clips.split) for clips in config.clips for motion in clips.motions(config.fps)
    ]
    for path in motion_files(files):
        motion = load_motion(path, fps=config.fps, up_axis=config.files.up_axis)
        faults = motion_faults(motion, turning=config.files.turning, path_speed=config.files.path_speed)
        if faults:
            print(f"left out {path}: {'; '.join(faults)}", file=sys.stderr)
            continue
        motions.append((arms_out(motion, config.files.arms_out), config.files.split(motion.name)))
    tasks = [
        Task(motion, split, single)
        for number, (motion, split) in enumerate(motions)
        for single in config.singles(number)
    ]
    # Clips of one garment and body next to each other: what a process has made for one, it has for the next.
    tasks.sort(key=lambda task: (task.name.partition("/")[0], task.config.body.title))
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
    next call. A rejected clip is listed in the data set, and made again only under other settings.

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
    standing, rejected = _standing(tasks, out)
    jobs = [_Job(task, out) for task in tasks if task.name not in standing | rejected.keys()]
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


def _standing(tasks: Sequence[Task], out: str | Path) -> tuple[set[str], dict[str, str]]:
    """Names of the clips that `out` holds, and of the tasks' those that it lists as rejected, with the reasons."""
    if place_at(out).empty():
        return set(), {}
    data = DataSet.open(out)
    listed = data.rejected()
    rejected = {
        task.name: listed[task.name]["reason"]
        for task in tasks
        if task.name in listed and listed[task.name]["made"] == _fingerprint(task)
    }
    return set(data.names()), rejected


def _make(job: _Job) -> _Made:
    """Simulate one clip and write it."""
    task, config = job.task, job.task.config
    data = DataSet.open_or_create(job.out, title=config.title, licence=config.licence, source=config.source)
    if data.has(task.name):  # the process that made it died between writing and saying so
        return _Made(f"{task.name}: stands")
    try:
        clip = simulate_clip(task.motion, config)[0]
    except Rejected as reason:
        data.reject(task.name, str(reason), _fingerprint(task))
        return _Made(str(reason), rejected=str(reason))
    data.write(task.name, clip, split=task.split)
    return _Made(f"{task.name} ({task.split}): {clip.n_frames} frames, {clip.info['quality']}")


def _fingerprint(task: Task) -> str:
    """A text that changes with whatever decides how the clip comes out."""
    settings = task.config.model_dump_json(exclude={"clips", "files", "title", "licence", "source"})
    motion = task.motion
    content = [settings.encode(), motion.poses.tobytes(), motion.trans.tobytes(), str(motion.fps).encode()]
    return hashlib.sha256(b"|".join(content)).hexdigest()[:16]


def _cut(motion: Motion, frames: int) -> Motion:
    if frames < 2:
        raise InputError(f"--frames {frames}: at least 2 are wanted")
    return replace(motion, poses=motion.poses[:frames], trans=motion.trans[:frames])
