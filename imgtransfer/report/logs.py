"""A training run's log as curves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from render import InputError

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
        InputError: no such file, or a line that is not such an object.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; the log of a training run is wanted")
    try:
        entries = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
        steps = [float(entry["step"]) for entry in entries]
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: not a training log of JSON lines with a step each ({error})") from error
    curves: Curves = {}
    for key, name in keys.items():
        pairs = [
            (step, float(entry[key])) for step, entry in zip(steps, entries, strict=True) if key in entry
        ]
        if pairs:
            blocks = np.array_split(np.array(pairs), min(points, len(pairs)))
            means = np.array([block.mean(axis=0) for block in blocks])
            curves[name] = means[:, 0].tolist(), means[:, 1].tolist()
    return curves
