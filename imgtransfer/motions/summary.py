"""What was taken from a motion file, in words, so that a wrong guess is seen before an hour of simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class MotionSummary:
    """How a motion file was read.

    Args:
        path: of the file.
        frames: that the file holds, before resampling.
        fps: frames a second of the file.
        up_axis: the file's axis that is up in the motion's world: y, z, -y and so on.
        unit: metres that the file's unit is read as.
        rest: what the joints' rotations are from, in words; "" where the format says it.
        joints: SMPL's joints and the file's; empty where the file's are SMPL's own.
        given: those of them that the user named.
    """

    path: Path
    frames: int
    fps: float
    up_axis: str
    unit: float
    rest: str = ""
    joints: Mapping[str, str] = field(default_factory=dict)
    given: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.path}: {self.frames} frames at {self.fps:.6g} a second; {self.manner()}"

    def manner(self) -> str:
        """How the file was read, which files of one tool have in common."""
        parts = [f"{self.up_axis} up", "in metres" if self.unit == 1 else f"a unit is {self.unit:.4g} m"]
        if self.rest:
            parts.append(self.rest)
        if self.joints:
            named = ", ".join(f"{joint} = {name}" for joint, name in self.joints.items())
            by = "by name" if not self.given else f"by name, {', '.join(self.given)} as given"
            parts.append(f"joints {by}: {named}")
        return "; ".join(parts)


def summary_lines(summaries: Sequence[MotionSummary]) -> list[str]:
    """One line for the files that were read in the same manner, so that a data set of thousands has few."""
    groups: dict[str, list[MotionSummary]] = {}
    for summary in summaries:
        groups.setdefault(summary.manner(), []).append(summary)
    lines = []
    for manner, files in groups.items():
        if len(files) == 1:
            lines.append(str(files[0]))
            continue
        rates = ", ".join(f"{rate:.6g}" for rate in sorted({summary.fps for summary in files}))
        frames = sum(summary.frames for summary in files)
        lines.append(
            f"{files[0].path} and {len(files) - 1} more: {frames} frames at {rates} a second; {manner}"
        )
    return lines
