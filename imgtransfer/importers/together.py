"""A garment and a body from two files, brought to the same frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from render import InputError, MeshSequence

_CLOSE = 0.01  # of a frame: times that are nearer are the same


def together(garment: MeshSequence, body: MeshSequence) -> tuple[MeshSequence, MeshSequence, str]:
    """The same frames of both: by time where both files have times, else by number. A single body is held still.

    Returns:
        Garment and body, and in words what was done where the files differ; "" where nothing was.

    Raises:
        InputError: other numbers of frames and no times, or times that have less than two frames in common.
    """
    if body.n_frames == 1 < garment.n_frames:
        held = replace(body.at(np.zeros(garment.n_frames)), fps=garment.fps)
        return (
            garment,
            held,
            f"{body.source}: one frame, held still for the {garment.n_frames} of {garment.source}",
        )
    if garment.n_frames == 1 or None in (garment.fps, garment.start, body.fps, body.start):
        _check_numbers(garment, body)
        return garment, body, ""
    return _by_time(garment, body)


def _by_time(garment: MeshSequence, body: MeshSequence) -> tuple[MeshSequence, MeshSequence, str]:
    times, others = _times(garment), _times(body)
    if len(times) == len(others) and (np.abs(times - others) <= _CLOSE * (times[1] - times[0])).all():
        return garment, body, ""
    step = others[1] - others[0]
    places = (times - others[0]) / step
    inside = np.flatnonzero((places >= -_CLOSE) & (places <= len(others) - 1 + _CLOSE))
    if len(inside) < 2:
        raise InputError(
            f"{_told(garment, times)}, but {_told(body, others)}; both must have the same time, or at least two frames "
            "of it"
        )
    note = (
        f"{_told(garment, times)}; {_told(body, others)}: matched by time, {len(inside)} frames from "
        f"{times[inside[0]]:g} s on"
    )
    start = float(times[inside[0]])
    cut = replace(garment.at(inside.astype(np.float64)), fps=garment.fps, start=start)
    moved = body.at(np.clip(places[inside], 0, len(others) - 1))
    return cut, replace(moved, fps=garment.fps, start=start), note


def _times(sequence: MeshSequence) -> np.ndarray:
    """(T,) seconds of the frames of a sequence that has times."""
    assert sequence.fps is not None
    assert sequence.start is not None
    return sequence.start + np.arange(sequence.n_frames) / sequence.fps


def _told(sequence: MeshSequence, times: np.ndarray) -> str:
    return f"{sequence.source}: {times[0]:g} to {times[-1]:g} s, {sequence.fps:g} frames a second"


def _check_numbers(garment: MeshSequence, body: MeshSequence) -> None:
    """Raise InputError where garment and body have different numbers of frames; none of these is read."""

    def told(sequence: MeshSequence) -> str:
        names = sequence.frame_names
        return f"{sequence.n_frames} frames" + (f" ({names[0]} to {names[-1]})" if names else "")

    if garment.n_frames != body.n_frames:
        raise InputError(
            f"{garment.source}: {told(garment)}, but {body.source} has {told(body)}; both must have the same frames"
        )
