"""What checks find wrong with a user's meshes, and stopping at it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from render import InputError, Option

FaultKind = Literal["unit", "axes", "apart", "inside", "inside_out", "seams", "pieces", "unused", "edges"]


@dataclass(frozen=True)
class MeshFault:
    """One thing that is wrong. `text` says what and how to mend it; `severe` stops the work unless told otherwise."""

    kind: FaultKind
    text: str
    severe: bool


def refuse(findings: Sequence[MeshFault], *, anyway: bool | None = False) -> list[str]:
    """Stop at severe findings.

    Args:
        findings: of the checks.
        anyway: go on all the same; None where the program does not let its user choose that.

    Returns:
        The texts of what does not stop the work, for the user to read.

    Raises:
        InputError: something severe; the message has all of it.
    """
    severe = [] if anyway else [finding.text for finding in findings if finding.severe]
    if severe:
        choice = "" if anyway is None else f" ({Option('anyway', True)} goes on all the same)"
        raise InputError("; ".join(severe) + choice)
    return [finding.text for finding in findings]
