"""What `imgtransfer fuse` says of many clips: a line for each, and at the end what was done and what to look at."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any

from render import Option

# As docs/fusion.md says of a report: a few millimetres, 0.1 to 0.3, and a few per cent are usual.
_TORN_MM, _NORMALS_OFF, _UNSEEN_PERCENT = 20.0, 0.5, 20.0


@dataclass(frozen=True)
class FusedClip:
    """What came of one clip.

    Args:
        name: its folder.
        frames: how many; 0 where they were not fused again.
        seconds: that fusing took.
        notes: what looks wrong, a text each.
    """

    name: str
    frames: int = 0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()

    def line(self) -> str:
        """One line about it."""
        done = f"{self.frames} frames, {self.seconds:.1f} s" if self.frames else "fused already"
        return "; ".join([f"{self.name}  {done}", *self.notes])


def notes_of(report: Mapping[str, Any]) -> tuple[str, ...]:
    """What in a fusion's report looks wrong, a text each: the one place where such notes are made.

    Args:
        report: of `fusion.fuse_maps`.
    """
    notes, starts = [], {stage: ends["start"] for stage, ends in report["terms"].items()}
    torn = 1000 * sqrt(starts.get("edge", {}).get("edge_length_m2", 0.0))
    if torn > _TORN_MM:
        notes.append(f"the maps are torn: edges are {torn:.0f} mm off in them")
    off = starts.get("normal", {}).get("normal_rendering", 0.0)
    if off > _NORMALS_OFF:
        notes.append(f"the normals do not belong to the positions: {off:.2f} apart")
    if report["unseen_percent"] > _UNSEEN_PERCENT:
        notes.append(f"{report['unseen_percent']:.0f} % of the vertices are in no view")
    inside = report.get("penetration_percent", {}).get("after", 0.0)
    if inside > 0:
        notes.append(f"{inside:.3g} % of the vertices are still in the body")
    return tuple(notes)


def summary(clips: Iterable[FusedClip]) -> str:
    """A few lines about all clips that did not fail: how many were fused, which were left, which to look at."""
    clips = list(clips)
    fused = [clip for clip in clips if clip.frames]
    frames, seconds = sum(clip.frames for clip in fused), sum(clip.seconds for clip in fused)
    lines = []
    if fused:
        lines.append(f"fused    {_count(fused)}, {frames:,} frames, {seconds / frames:.3f} s a frame")
    if left := len(clips) - len(fused):
        lines.append(
            f"left     {left} of {_count(clips)}, fused with these settings already; {Option('overwrite', True)} does "
            f"{'them' if left > 1 else 'it'} again"
        )
    odd = [clip for clip in fused if clip.notes]
    if odd:
        lines.append(f'look at  {_count(odd)}, see "When it goes wrong" in docs/fusion.md:')
        lines += [f"  {clip.name}: {'; '.join(clip.notes)}" for clip in odd]
    return "\n".join(lines)


def _count(clips: list[FusedClip]) -> str:
    return f"{len(clips)} clip{'' if len(clips) == 1 else 's'}"
