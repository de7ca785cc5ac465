"""What checks find wrong with a user's meshes, and stopping at it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from render import InputError

FaultKind = Literal["unit", "axes", "apart", "inside", "inside_out", "seams", "pieces", "unused", "edges"]
Say = Callable[[str, str], str]  # an option's name and value -> what messages call it


@dataclass(frozen=True)
class MeshFault:
    """One thing that is wrong. `text` says what and how to mend it; `severe` stops the work unless told otherwise."""

    kind: FaultKind
    text: str
    severe: bool


def as_flag(name: str, value: str) -> str:
    """An option as the command line has it; those without a value are switches."""
    return f"--{name}={value}" if value else f"--{name}"


def refuse(
    findings: Sequence[MeshFault], *, anyway: bool = False, hint: str = " (--anyway goes on all the same)"
) -> list[str]:
    """Stop at severe findings.

    Args:
        anyway: go on all the same. hint: what the message ends with.

    Returns:
        The texts of what does not stop the work, for the user to read.

    Raises:
        InputError: something severe; the message has all of it.
    """
    severe = [] if anyway else [finding.text for finding in findings if finding.severe]
    if severe:
        raise InputError(f"{'; '.join(severe)}{hint}")
    return [finding.text for finding in findings]
