"""Clips are chosen by glob patterns of their names, in every command and configuration."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from render import InputError


class NoClip(InputError):
    """There are clips, none of which is chosen."""


def choose(
    source: str | Path,
    candidates: Sequence[str],
    *,
    names: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    asked: str = "",
    present: Sequence[str] | None = None,
) -> list[str]:
    """The names of clips that glob patterns choose, in the order of `candidates`.

    Args:
        source: what an InputError calls the place that the clips are in.
        candidates: to choose from.
        names: patterns of the clips to take; None takes all.
        exclude: patterns of clips to leave out.
        asked: how `candidates` were chosen, for the message; `present`: what they were chosen from.

    Raises:
        NoClip: nothing matches; the message lists what there is.
    """
    chosen = [
        name
        for name in candidates
        if (names is None or any(fnmatch(name, pattern) for pattern in names))
        and not any(fnmatch(name, pattern) for pattern in exclude)
    ]
    if not chosen:
        wanted = [asked] if asked else []
        wanted += [f"names {', '.join(names)}"] if names is not None else []
        wanted += [f"without {', '.join(exclude)}"] if exclude else []
        there = candidates if present is None else present
        raise NoClip(
            f"{source}: no clip matches ({'; '.join(wanted) or 'all'}); there are {some(there) or 'none'}"
        )
    return chosen


def some(names: Sequence[str], most: int = 12) -> str:
    """Names for a message: all of a few, the first of many and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"
