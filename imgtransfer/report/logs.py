"""A training run's log as curves."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from render import InputError
from render.files.atomic import check_regular

_log = logging.getLogger(__name__)

Curves = dict[str, tuple[list[float], list[float]]]


def read_entries(path: Path) -> tuple[list[dict[str, Any]], int]:
    """The entries of a log in the order of the file, and how many lines are no such entries.

    A run that is killed, or runs out of disk, may leave half a line; that must not cost the others.

    Raises:
        InputError: no regular file.
    """
    check_regular(path, "the log of a training run")
    lines = [line for line in path.read_bytes().splitlines() if line.strip()]
    entries = [entry for line in lines if (entry := _entry(line)) is not None]
    return entries, len(lines) - len(entries)


def _entry(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line.decode())
    except (ValueError, RecursionError):  # not JSON, or not UTF-8
        return None
    step = entry.get("step") if isinstance(entry, dict) else None
    whole = isinstance(step, int | float) and not isinstance(step, bool) and math.isfinite(step)
    return entry if whole else None


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
