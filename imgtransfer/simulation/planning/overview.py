"""What a plan would simulate, in words, before it is simulated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from imgtransfer.garments.config import TemplateConfig
from imgtransfer.importers.checks.weld import weld
from imgtransfer.importers.formats.meshes import FPS
from imgtransfer.importers.summary import Summary, lying_facts, mesh_text, motion_text, rate_text, size_text
from imgtransfer.simulation.body_motion.body_sequence import BodySequence
from imgtransfer.simulation.planning.job import standing
from imgtransfer.simulation.planning.task import Task
from render import Option
from render.files.sequence import load_file


def summaries_of(tasks: Sequence[Task]) -> list[Summary]:
    """What was taken of the user's own meshes: a summary a garment and a mesh sequence."""
    own = [task.config.garment for task in tasks if isinstance(task.config.garment, TemplateConfig)]
    garments = {garment.path: garment for garment in own}
    sequences = {task.motion.moving: task.motion for task in tasks if isinstance(task.motion, BodySequence)}
    return [*map(_of_garment, garments.values()), *map(_of_sequence, sequences.values())]


def plan_lines(tasks: Sequence[Task], out: str | Path) -> Iterator[str]:
    """A line a clip: what it is called, how long it is, on what body, and whether `out` has it; and their number.

    Before them a line for each garment that was drawn at random, with its sizes.

    Raises:
        InputError: `out` is something else than a data set, or cannot be written.
    """
    there, rejected = standing(tasks, out)
    drawn = {task.config.garment.title: task.config.garment for task in tasks if task.drawn}
    for title, garment in drawn.items():
        sizes = garment.model_dump(exclude={"kind", "name", "detail"}, exclude_unset=True)
        yield f"garment {title}: {', '.join(f'{name} {size:g}' for name, size in sizes.items())}"
    new = 0
    for task in tasks:
        state = "stands already" if task.name in there else "rejected before" if task.name in rejected else ""
        new += not state
        body = (
            "its own body" if isinstance(task.motion, BodySequence) else task.config.body.title or "the body"
        )
        seconds = (_frames(task) - 1) / task.config.fps
        parts = [f"{_frames(task)} frames, {seconds:.2f} s", f"on {body}", *([state] if state else [])]
        yield f"{task.name} ({task.split}): {', '.join(parts)}"
    yield f"dry run  {new} of {len(tasks)} clips would be simulated into {out}; nothing was written"


def _frames(task: Task) -> int:
    """How many frames a clip will have."""
    motion = task.motion
    return motion.count() if isinstance(motion, BodySequence) else len(motion.poses)


def _of_garment(garment: TemplateConfig) -> Summary:
    loaded = load_file(garment.path, Option("garment_object", garment.object))
    mesh = garment.axes.of_mesh(loaded)
    joined = weld(mesh).joined if garment.weld else None
    facts = [
        ("garment", f"{mesh_text(mesh, joined)}; {size_text(mesh)}"),
        *lying_facts(None, garment.axes.of_file(loaded.axes)),
    ]
    return Summary(str(garment.path), tuple(facts))


def _of_sequence(sequence: BodySequence) -> Summary:
    opened = sequence.open()
    moving = opened.sequence
    facts = [
        ("body", motion_text(moving)),
        ("", f"{len(moving.mesh.vertices)} vertices; {size_text(moving.mesh)}"),
        *lying_facts(moving.mesh, opened.axes, {"frames": opened.frames}),
        ("rate", rate_text(sequence.settings.fps, moving.fps, FPS)),
    ]
    return Summary(sequence.name, tuple(facts))
