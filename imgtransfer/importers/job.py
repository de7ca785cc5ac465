"""Clips to import, one job each: skipped where they are there already, written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.choice import choose
from imgtransfer.data.clip import Clip
from imgtransfer.data.store import DataSet, check_name
from imgtransfer.importers.checks.axes import AS_AT_REST, Axes, MotionAxes
from imgtransfer.importers.summary import Summary
from imgtransfer.running.fingerprint import MADE, fingerprint, recorded
from render import InputError
from render.files.scenes.reader import is_scene
from render.files.textures import change_paths


@dataclass(frozen=True)
class ImportOptions:
    """What a user may say about an import; which of them count depends on the format.

    Args:
        split: for every clip; None takes the format's standard split.
        garment: name of the garment in the data set; None takes the format's.
        clips: glob patterns of clips' names, "<garment>/<clip>"; None takes all.
        fps: frames a second; None takes the file's, else the format's.
        template: the garment in the body's rest pose, a mesh file (or for `vto` a folder of <garment>.obj).
        body_rest: the body in its rest pose, a mesh file.
        smpl: folder with the files of the SMPL body model, or one of them.
        gender: of the SMPL body, where the format does not say.
        axes: how the meshes' coordinates lie.
        garment_axes: how the garment's lie; None where they are as the body's.
        motion_axes: how the frames of both lie where they lie otherwise than the rest meshes.
        garment_object, body_object: which mesh of an Alembic or USD file is the garment and the body, by name or path;
            None takes the only one.
        weld: join split seams. anyway: import although the checks found something.
    """

    split: str | None = None
    garment: str | None = None
    clips: tuple[str, ...] | None = None
    fps: float | None = None
    template: Path | None = None
    body_rest: Path | None = None
    smpl: Path | None = None
    gender: str | None = None
    axes: Axes = field(default_factory=Axes)
    garment_axes: Axes | None = None
    motion_axes: MotionAxes = AS_AT_REST
    garment_object: str | None = None
    body_object: str | None = None
    weld: bool = False
    anyway: bool = False


@dataclass(frozen=True)
class Job:
    """One clip to import.

    Args:
        name: in the data set, "<garment>/<clip>".
        split: such as train or test.
        files: what it is read from.
        read: reads the clip; raises InputError.
        summary: what is taken, where that is known before the clip is read.
        marked: whether the data set notes what the clip was imported from; else the clip comes as it is, and what it
            holds says that.
    """

    name: str
    split: str
    files: tuple[Path, ...]
    read: Callable[[], Clip]
    summary: Summary | None = None
    marked: bool = True

    def fingerprint(self, options: ImportOptions) -> str:
        """A text that changes with the files (their names, sizes and times: public sets are too large to be read for
        this) and the options.
        """
        files = [
            (file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in self.files if file.is_file()
        ]
        told = [self.name, files, repr(replace(options, clips=None, split=None))]
        if any(is_scene(file) for file in self.files):
            # Such files say how they lie, so that it matters whether `--unit=m` was given or is the default.
            axes = [lay for lay in (options.axes, options.garment_axes) if lay is not None]
            told.append([sorted(lay.given) for lay in axes])
        return fingerprint([json.dumps(told)])


def chosen(jobs: Sequence[Job], options: ImportOptions, source: object) -> list[Job]:
    """The jobs that `options.clips` asks for, checked.

    Raises:
        InputError: none of them, two of one name, or a name or split that a data set cannot have.
    """
    names = [job.name for job in jobs]
    taken = set(choose(str(source), names, names=options.clips))
    chosen_jobs = [job for job in jobs if job.name in taken]
    twice = sorted({job.name for job in chosen_jobs if names.count(job.name) > 1})
    if twice:
        raise InputError(
            f"several files would become clip {', '.join(twice)}; rename them or import them apart"
        )
    for job in chosen_jobs:
        check_name(job.name, job.split)
    return chosen_jobs


def run_jobs(jobs: Sequence[Job], data: DataSet, options: ImportOptions) -> int:
    """Import clips with a bar; what is there already from the same files with the same options is left.

    A clip that cannot be read does not keep the others from being imported.

    Returns:
        How many were there already.

    Raises:
        InputError: after all others, naming those that could not be read.
    """
    present = set(data.names())
    kept, failed = 0, []
    for job in tqdm(jobs, desc="import", unit="clip", disable=None):
        there = job.name in present and data.split(job.name) == job.split
        record = {MADE: job.fingerprint(options)} if job.marked else {}
        if there and record and recorded(data.clip_attributes(job.name).info) == record[MADE]:
            kept += 1
            continue
        try:
            clip = job.read()
        except InputError as error:
            known = any(str(file) in str(error) or str(file.parent) in str(error) for file in job.files)
            failed.append(str(error) if known else f"{job.files[0]}: {error}")
            continue
        if there and not record and _content(clip) == _stored_content(data, job.name):
            kept += 1
            continue
        data.write(job.name, replace(clip, info=clip.info | record), split=job.split)
    if failed:
        if len(jobs) == 1:
            raise InputError(failed[0])
        more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
        raise InputError(f"{len(failed)} of {len(jobs)} clips were not imported: {failed[0]}{more}")
    return kept


def _stored_content(data: DataSet, name: str) -> str | None:
    """`_content` of a clip of the data set; None where that is not whole, so that it is written again."""
    if not data.has(name):
        return None
    try:
        return _content(data.read(name))
    except InputError:
        return None


def _content(clip: Clip) -> str:
    """A fingerprint of all that a clip holds."""

    def parts() -> Iterator[str | memoryview]:
        yield json.dumps([clip.fps, sorted(_told(clip).items())])
        for key, array in clip.arrays().items():
            yield f"{key} {array.shape}"
            yield np.ascontiguousarray(array).data

    return fingerprint(parts())


def _told(clip: Clip) -> dict[str, str]:
    """A clip's texts; textures, which every store has in another place, count by their names."""
    return {
        key: change_paths(text, lambda path: Path(path).name if Path(path).is_absolute() else None)
        if key == "mtl"
        else text
        for key, text in clip.texts().items()
    }
