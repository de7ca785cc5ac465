"""Whether frames lie as their rest meshes do: in the same units, with the same axis up."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from imgtransfer.importers.checks.axes import AXES, UNITS, Axes, InMetres, axis_name, axis_vector, guess_axes
from imgtransfer.importers.checks.findings import MeshFault, refuse
from render import MeshSequence, Option
from render.mesh.measures import edge_lengths

_log = logging.getLogger(__name__)

_FRAMES = 5  # that are looked at, from the first to the last
_SAMPLES = 4000  # vertices and edges that are
_SIZE = 1.5  # by which edges may be longer or shorter than at rest, in the middle
_TORN = (
    0.2  # of the edges that change by more than this apart from a common factor: vertices in another order
)
_UPRIGHT = 0.5  # cosine of the angle to the vertical from which on a mesh does not lie
_ALONG = 0.7  # likewise to the axis that it lies along, in every frame


@dataclass(frozen=True)
class MotionFacts:
    """How a mesh in motion compares with its rest pose.

    Args:
        size: how many times as large it is in its frames, by the lengths of its edges.
        up: the axis of ours, one of `AXES`, along which what was up at rest lies in every frame; None where it is
            upright in some of them, or lies now along one and now along another.
    """

    size: float
    up: str | None


def motion_facts(sequence: MeshSequence) -> MotionFacts | None:
    """Compare some frames with the mesh at rest; None where that tells nothing: a line, a point, or another mesh.

    Raises:
        InputError: frames that cannot be read.
    """
    rest = sequence.mesh
    used = np.unique(rest.faces)
    used = used[:: max(1, len(used) // _SAMPLES)]
    edges = rest.edges[:: max(1, len(rest.edges) // _SAMPLES)]
    lengths = edge_lengths(rest.vertices, edges)
    if not (lengths > 0).any():
        return None
    edges, lengths = edges[lengths > 0], lengths[lengths > 0]
    sizes, ups = [], []
    numbers = sorted({round(step) for step in np.linspace(0, sequence.n_frames - 1, _FRAMES)})
    for moved in np.asarray(sequence.frames(numbers), np.float64):
        ratio = np.maximum(edge_lengths(moved, edges) / lengths, 1e-12)
        size, turn = float(np.median(ratio)), _turn(rest.vertices[used], moved[used])
        torn = np.abs(np.log(ratio / size)) > np.log(_SIZE)
        if turn is None or torn.mean() > _TORN:
            return None
        sizes.append(size)
        ups.append(turn[:, 1])
    return MotionFacts(float(np.median(sizes)), _lying_along(np.array(ups)))


def check_motion(moving: Sequence[InMetres]) -> list[MeshFault]:
    """Check meshes in motion against their rest poses; arrays, which have no axes of their own, are passed over.

    Args:
        moving: metres, y up, as the files and the user say.

    Returns:
        A fault where some are in other units than their rest meshes, and one where some lie along another axis. The
        options that mend it hold for the frames of all, so they are named only where all show the same.

    Raises:
        InputError: frames that cannot be read.
    """
    frames = [one.frames for one in moving if one.frames is not None]
    sequences = [one.sequence for one in moving if one.frames is not None]
    facts = [motion_facts(sequence) for sequence in sequences]
    units = [None if fact is None else _unit(fact, lay) for fact, lay in zip(facts, frames, strict=True)]
    ups = [
        None if fact is None or fact.up is None else _of_file(fact.up, lay)
        for fact, lay in zip(facts, frames, strict=True)
    ]
    found = []
    if any(unit is not None for unit in units):
        text = "; ".join(
            f"{sequence.source}: its frames are {fact.size:.3g} times as large as {sequence.mesh.source}"
            for sequence, fact, unit in zip(sequences, facts, units, strict=True)
            if fact is not None and unit is not None
        )
        named = units[0] if len(set(units)) == 1 and units[0] else None
        hint = f"add {Option('motion_unit', named)}" if named else "export both in the same units"
        found.append(MeshFault("unit", f"{text}, in other units: {hint}", True))
    if any(up is not None for up in ups):
        text = "; ".join(
            f"{sequence.source}: upright in {sequence.mesh.source}, but its frames all lie, with {up} up"
            for sequence, up in zip(sequences, ups, strict=True)
            if up is not None
        )
        hint = (
            f"add {Option('motion_up', ups[0])}"
            if len(set(ups)) == 1
            else "export both with the same axis up"
        )
        found.append(MeshFault("axes", f"{text}: {hint}", True))
    return found


def note_motion(moving: Sequence[InMetres]) -> None:
    """As `check_motion`, for programs that go on with frames that lie, which are noted: people do lie.

    Raises:
        InputError: frames that cannot be read, or that are in other units than their rest meshes.
    """
    found = check_motion(moving)
    for one in moving:
        guess = guess_axes(one.sequence.mesh.vertices)
        if one.frames is not None and guess is not None and (guess.up, guess.facing) != ("y", "z"):
            # How its frames lie tells nothing before its rest pose stands.
            found = [fault for fault in found if fault.kind != "axes"]
            right = Axes(_of_file(guess.up, one.axes), _of_file(guess.facing, one.axes))
            text = (
                f"{one.sequence.mesh.source}: stands along {right.up} and faces {right.facing}: add {right}"
            )
            found.append(MeshFault("axes", text, True))
            break
    for text in refuse([replace(fault, severe=fault.kind == "unit") for fault in found], anyway=None):
        _log.warning("note: %s", text)


def _turn(rest: np.ndarray, moved: np.ndarray) -> np.ndarray | None:
    """(3, 3) the rotation that best takes (N, 3) points at rest to where they moved; None where none is best."""
    u, sizes, vt = np.linalg.svd((moved - moved.mean(0)).T @ (rest - rest.mean(0)))
    if sizes[1] <= 1e-6 * sizes[0]:
        return None
    turn: np.ndarray = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn


def _lying_along(ups: np.ndarray) -> str | None:
    """The axis along which (T, 3) directions lie, all of them away from the vertical; None where there is none."""
    if (ups[:, 1] > _UPRIGHT).any():
        return None
    for axis in AXES:
        if (ups @ axis_vector(axis) > _ALONG).all():
            return axis
    return None


def _unit(fact: MotionFacts, lay: Axes) -> str | None:
    """The unit in which frames are as large as their rest mesh, "" if none of `UNITS` is; None if they are already."""
    if 1 / _SIZE <= fact.size <= _SIZE:
        return None
    metres = lay.scale / max(fact.size, 1e-12)
    fitting = [name for name, value in UNITS.items() if 0.95 < value / metres < 1.05]
    return fitting[0] if fitting else ""


def _of_file(axis: str, lay: Axes) -> str:
    """What an axis of ours is in a file that lay so."""
    direction = lay.rotation.T @ axis_vector(axis)
    largest = int(np.abs(direction).argmax())
    return axis_name(largest, direction[largest])
