"""What was taken from files, in words, so that a wrong guess is seen before an hour of work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.importers.checks.axes import UNITS, Axes, guess_axes
from imgtransfer.importers.checks.topology import used_part
from render import Mesh, MeshSequence, Option
from render.errors import one_line

_MOST_NAMES = 6  # of materials


@dataclass(frozen=True)
class Summary:
    """What was taken for one clip, garment or body. Whatever reads files may fill one.

    Args:
        title: what it is about.
        facts: what, and in words how it was read, such as ("rate", "30 a second, from the file").
    """

    title: str
    facts: tuple[tuple[str, str], ...]

    def lines(self, before: Summary | None = None) -> Iterator[str]:
        """The title, and a line a fact; of those that the summary before has, too, only that they are the same."""
        known = set() if before is None else set(before.facts)
        yield one_line(self.title)
        width = max((len(what) for what, _ in self.facts), default=0)
        new = [fact for fact in self.facts if fact not in known]
        for what, text in new:
            yield f"  {what:<{width}}  {one_line(text)}"
        if same := [what for what, _ in self.facts if what not in {name for name, _ in new}]:
            yield f"  {', '.join(dict.fromkeys(same))} as above"


def told(summaries: Sequence[Summary]) -> str:
    """Summaries for a terminal, each with what differs from the one before."""
    before: list[Summary | None] = [None, *summaries]
    return "\n".join(
        line for last, summary in zip(before, summaries, strict=False) for line in summary.lines(last)
    )


def motion_text(moving: MeshSequence) -> str:
    """Where a mesh in motion comes from: its frames, and its rest pose."""
    names = moving.frame_names
    frames = f" ({names[0]} to {names[-1]})" if names and len(names) > 1 else ""
    number = f"{moving.n_frames} frames" if moving.n_frames != 1 else "1 frame"
    first = moving.mesh.source in (moving.source, *(names or ())) or (
        names is not None and Path(moving.mesh.source).name == names[0]
    )
    return f"{moving.source}: {number}{frames}, at rest as in {'the first frame' if first else moving.mesh.source}"


def mesh_text(mesh: Mesh, joined: int | None = None) -> str:
    """What a mesh is made of.

    Args:
        mesh: as its file has it. joined: how many vertices were welded away; None where nobody asked.
    """
    parts = [f"{len(mesh.vertices)} vertices", f"{len(mesh.faces)} triangles"]
    if joined is not None:
        parts.append(f"{joined} vertices joined at seams")
    surface = mesh.surface
    parts.append("no UVs" if surface is None or surface.uvs is None else "UVs")
    names = () if surface is None else surface.materials
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    parts.append(f"materials {', '.join(names[:_MOST_NAMES])}{more}" if names else "no materials")
    return ", ".join(parts)


def size_text(mesh: Mesh) -> str:
    """How large a mesh in our axes is, and what of its file was not taken."""
    width, height, depth = np.ptp(used_part(mesh).vertices, axis=0)
    without = f"; not taken: {'; '.join(mesh.left_out)}" if mesh.left_out else ""
    return f"{height:.2f} m high, {width:.2f} m wide, {depth:.2f} m deep{without}"


def rate_text(given: float | None, of_files: float | None, assumed: float) -> str:
    """Frames a second, and who says so."""
    if given is not None:
        return f"{given:g} a second, given"
    if of_files is not None:
        return f"{of_files:g} a second, from the file"
    return f"{assumed:g} a second, assumed: the files do not say it ({Option('fps')} does)"


def lying_facts(
    body: Mesh | None, axes: Axes, others: Mapping[str, Axes | None] | None = None
) -> list[tuple[str, str]]:
    """Units and axes, and whether they were given, stand in the file or were assumed.

    Args:
        body: at rest, in our axes, whose shape may tell; None where there is none.
        axes: how its file lay. others: how others lay, by what they are called; told where it is otherwise.
    """
    guess = None if body is None else guess_axes(used_part(body).vertices @ axes.rotation)
    by = _by(axes, {"up", "facing"}, assumed=(axes.up, axes.facing) == ("y", "z"))
    if guess is not None and (guess.up, guess.facing) == (axes.up, axes.facing):
        by = "from the file" if "up" in axes.said else "as the body's shape tells"
    elif body is not None and guess is None:
        by += ": the body's shape does not tell"
    unit = "metres" if axes.scale == 1 else _unit(axes.scale)
    facts = [
        ("units", f"{unit}, {_by(axes, {'scale'}, assumed=axes.scale == 1)}"),
        ("axes", f"{axes.up} up, facing {axes.facing}, {by}"),
    ]
    for name, lay in (others or {}).items():
        if lay is not None and lay != axes:
            text = f"{_unit(lay.scale)}, {lay.up} up, facing {lay.facing}"
            facts.append((f"{name} in", f"{text}, {_by(lay, {'up', 'facing', 'scale'}, assumed=False)}"))
    return facts


def _by(axes: Axes, what: set[str], *, assumed: bool) -> str:
    """Who says how a file lies in what is asked for."""
    if what & axes.given:
        return "given"
    if what & axes.said:
        return "from the file"
    return "assumed" if assumed else "given"


def clip_summary(title: str, clip: Clip) -> Summary:
    """What a clip that was read holds."""
    skin = Mesh(clip.body.rest, clip.body.faces)
    facts = [
        ("garment", f"{mesh_text(clip.template_mesh)}; {size_text(clip.template_mesh)}"),
        ("body", f"{len(skin.vertices)} vertices; {size_text(skin)}"),
        ("frames", f"{clip.n_frames} at {clip.fps:g} a second"),
    ]
    return Summary(title, tuple(facts))


def _unit(scale: float) -> str:
    return next((unit for unit, metres in UNITS.items() if np.isclose(metres, scale)), f"{scale:g} m a unit")
