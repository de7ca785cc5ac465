"""A training run's log as curves."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from imgtransfer.training.log import read_entries
from render import InputError
from render.files.atomic import check_regular

_log = logging.getLogger(__name__)

Curves = dict[str, tuple[list[float], list[float]]]


def read_curves(path: str | Path, keys: Mapping[str, str], *, points: int = 150) -> Curves:
    """Values over steps out of a log of JSON lines.

    Args:
        path: `log.jsonl` of a run: one object a line, each with "step".
        keys: which values to take, and what to call each in a picture.
        points: at most so many; neighbouring values are averaged, which also smooths the noise of batches.

    Returns:
        By name, steps and values, for `curve_picture`; a key that no line has gives no curve.

    Raises:
        InputError: no such file, or no line that is such an object; where some are not, a note says so.
    """
    path = Path(path)
    check_regular(path, "the log of a training run")
    entries, unreadable = read_entries(path)
    if unreadable and not entries:
        raise InputError(f"{path}: not a training log of JSON lines with a step each")
    if unreadable:
        _log.warning("note: %s: %d damaged lines are left out", path, unreadable)
    curves: Curves = {}
    for key, name in keys.items():
        pairs = [
            (float(entry["step"]), float(entry[key]))
            for entry in entries
            if isinstance(entry.get(key), int | float)
        ]
        if pairs:
            blocks = np.array_split(np.array(pairs), min(points, len(pairs)))
            means = np.array([block.mean(axis=0) for block in blocks])
            curves[name] = means[:, 0].tolist(), means[:, 1].tolist()
    return curves
