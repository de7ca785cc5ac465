"""The clips that are to be simulated, with all that can be wrong about their files found before any work is done."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from imgtransfer.data.choice import choose
from imgtransfer.data.schema import check_name
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.motions.motion import Motion, arms_out
from imgtransfer.simulation.body_motion.body_sequence import find_sequence
from imgtransfer.simulation.body_motion.unskinned import needs_template
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.motion_config import Split
from imgtransfer.simulation.planning.file_checks import check_files, steady
from imgtransfer.simulation.planning.motion_files import read_motions
from imgtransfer.simulation.planning.sources import MotionFile, sorted_sources
from imgtransfer.simulation.planning.task import Task
from render import InputError, Option
from render.threads import one_blas_thread


@one_blas_thread()
def plan(
    config: SimulateConfig,
    sources: Sequence[Path] = (),
    *,
    frames: int | None = None,
    clips: Sequence[str] | None = None,
    source: str = "simulate",
) -> list[Task]:
    """The clips that a configuration, motion files and body mesh sequences (or folders of them) ask for.

    A motion in which a joint turns too far or too fast for a body is left out, and named in the log; likewise one that
    cannot be read, where others can, and a mesh sequence with a vertex that jumps. Bodies' and garments' own files are
    read here and checked against each other, each pair once; what is odd about them but no obstacle is logged.

    Args:
        config: with clips of the motion library, and the garments and bodies that all motions are simulated with.
        sources: motion files, mesh sequences' folders, and folders of either.
        frames: keep only so many frames of each.
        clips: glob patterns of the names of clips to take; None takes all.
        source: what messages call the configuration.

    Returns:
        A task a clip; those of one garment and body follow each other.

    Raises:
        InputError: nothing to simulate, or nothing that `clips` name, two clips of one name, files that cannot be
            read, a garment that does not fit its body, or one that cannot be made for a mesh sequence.
    """
    if frames is not None and frames < 2:
        raise InputError(f"{Option('frames')} {frames}: at least 2 are wanted")
    files, folders = sorted_sources(sources)
    tasks = [*_of_motions(config, files, frames), *_of_sequences(config, folders, frames)]
    _check_names(tasks)
    tasks = _chosen(tasks, clips)
    check_files(tasks)
    tasks = [replace(task, config=_anywhere(task.config)) for task in steady(tasks)]
    # Clips of one garment and body next to each other: what a process has made for one, it has for the next.
    tasks.sort(key=lambda task: (task.name.partition("/")[0], task.config.body.title))
    if not tasks:
        raise InputError(
            f"{source}: nothing to simulate: list clips in the configuration, or give motion files, body mesh "
            "sequences or folders of them"
        )
    return tasks


def _anywhere(config: SimulateConfig) -> SimulateConfig:
    """The configuration with the full path of a garment's file: a cluster's workers have other working folders."""
    garment = config.garment
    if not isinstance(garment, TemplateConfig):
        return config
    return config.model_copy(update={"garment": garment.model_copy(update={"path": garment.path.resolve()})})


def _of_motions(config: SimulateConfig, files: Sequence[MotionFile], frames: int | None) -> Iterator[Task]:
    motions: list[tuple[Motion, Split, Sequence[str]]] = [
        (motion, clips.split, clips.garments)
        for clips in config.clips
        for motion in clips.motions(config.fps)
    ]
    for motion, stem in read_motions(files, config):
        motions.append((arms_out(motion, config.files.arms_out), config.files.split(motion.name, stem), ()))
    drawn = config.drawn()
    for number, (motion, split, garments) in enumerate(motions):
        cut = replace(motion, poses=motion.poses[:frames], trans=motion.trans[:frames])
        for single in config.singles(number, garments):
            yield Task(cut, split, single, drawn=single.garment.title in drawn)


def _of_sequences(config: SimulateConfig, folders: Sequence[Path], frames: int | None) -> Iterator[Task]:
    for garment in config.wardrobe():
        if folders and not isinstance(garment, TemplateConfig):
            raise InputError(f"{folders[0]}: {needs_template(garment)}")
    config = config.model_copy(update={"every_body": False})  # the configuration's bodies have no part in it
    for folder in folders:
        sequence = replace(find_sequence(folder, config.sequences, config.fps), frames=frames)
        for single in config.singles(0):
            yield Task(sequence, config.files.split(sequence.name), single)


def _check_names(tasks: Sequence[Task]) -> None:
    """Raise InputError where a clip cannot be stored under its name, or two have the same."""
    names = [task.name for task in tasks]
    for task in tasks:
        check_name(task.name, task.split)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"clips {', '.join(twice)} are asked for more than once; give them other seeds or file names"
        )


def _chosen(tasks: list[Task], patterns: Sequence[str] | None) -> list[Task]:
    """The tasks whose names match one of the patterns.

    Raises:
        InputError: there are tasks, but none matches.
    """
    if patterns is None or not tasks:
        return tasks
    taken = set(choose(str(Option("clips")), sorted(task.name for task in tasks), names=patterns))
    return [task for task in tasks if task.name in taken]
