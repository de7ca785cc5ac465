"""The order that people mean by the numbers in file names."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path


def natural(text: str) -> list[tuple[int, int, str]]:
    """A sorting key by which frame_2 comes before frame_10."""
    parts = re.split(r"(\d+)", text)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part.lower()) for part in parts]


def natural_sort(paths: Iterable[Path]) -> list[Path]:
    """Paths sorted by name, numbers by their value."""
    return sorted(paths, key=lambda path: natural(path.name))
