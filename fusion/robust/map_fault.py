"""What is wrong with position maps, and where; over a clip, without keeping its frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from render.mesh.mesh import Mesh

Kind = Literal["offset", "unfit", "scale", "views"]


@dataclass(frozen=True)
class MapFault:
    """What does not fit in the position maps of one frame.

    Args:
        kind: `offset`: a part of a view holds together, but lies off what is around it; `unfit`: the pixels of a part
            fit neither each other nor others; `scale`: whole maps are larger or smaller than the garment; `views`: two
            views put what both see at different places.
        view: the camera's name, or two of them; empty where it is of all.
        pixels: how many it concerns.
        offset_m: metres by which the part, or one view, is off; 0 where it is something else.
        scale: median of its steps over the garment's; 1 where that was not looked at.
        rows, columns: first and last of a part, counted from 0 at the top left; None of whole maps.
        vertex: the template's nearest to the middle of a part.
        place: where on the garment a part is, in words.
    """

    kind: Kind
    view: str
    pixels: int
    offset_m: float = 0.0
    scale: float = 1.0
    rows: tuple[int, int] | None = None
    columns: tuple[int, int] | None = None
    vertex: int | None = None
    place: str = ""

    def continues(self, other: MapFault) -> bool:
        """Whether both are of one kind and view, and of parts whose rows and columns have a pixel in common."""
        return (
            (self.kind, self.view) == (other.kind, other.view)
            and _meet(self.rows, other.rows)
            and _meet(self.columns, other.columns)
        )

    def __str__(self) -> str:
        """One line; lengths in millimetres."""
        off = f"{1000 * self.offset_m:.0f} mm"
        if self.kind == "views":
            return f"{self.view}: {off} apart where both see the garment"
        if self.kind == "scale":
            return (
                f"the maps are {self.scale:.2f} times as large as the garment; is it their box, or the unit?"
            )
        assert self.rows is not None
        assert self.columns is not None
        where = (
            f"{self.view}: {self.pixels} pixels at the {self.place} (rows {_span(self.rows)}, columns "
            f"{_span(self.columns)}, about vertex {self.vertex})"
        )
        size = f", {self.scale:.2f} times as large as the garment," if not 0.9 < self.scale < 1.1 else ""
        if self.kind == "offset":
            return f"{where}{size} lay {off} off their surroundings: brought back"
        return f"{where} fit neither each other nor their surroundings{size.removesuffix(',')}: left out"


@dataclass(frozen=True, eq=False)
class MapFindings:
    """What was found in the position maps of T frames.

    Args:
        left_out: (T,) fraction of the covered pixels that were left out, of those with a confidence.
        faults: by frame.
    """

    left_out: np.ndarray
    faults: Sequence[Sequence[MapFault]]


def place_on(mesh: Mesh, points: np.ndarray) -> tuple[int, str]:
    """The vertex nearest to the middle of some points of a template, and where that is, in words.

    Args:
        mesh: the template, y up, the wearer facing +z, so that +x is the wearer's left.
        points: (P, 3) metres, on the template.
    """
    middle = points.mean(0)
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    part = (middle - low) / np.maximum(high - low, 1e-12)  # 0 to 1 in each direction
    upwards = ("bottom", "middle", "top")[min(int(3 * part[1]), 2)]
    sideways = ("wearer's right", "centre", "wearer's left")[min(int(3 * part[0]), 2)]
    return int(np.linalg.norm(mesh.vertices - middle, axis=1).argmin()), f"{sideways}, {upwards}"


class FaultLog:
    """The faults of a clip: those that go on from frame to frame are one."""

    def __init__(self) -> None:
        self._entries: list[_Entry] = []

    def add(self, frame: int, faults: Iterable[MapFault]) -> None:
        """Take in the faults of a frame; frames come in order."""
        for fault in faults:
            entry = next((entry for entry in self._entries if entry.latest.continues(fault)), None)
            if entry is None:
                self._entries.append(_Entry(fault, frame))
            else:
                entry.add(fault, frame)

    def report(self) -> list[dict[str, Any]]:
        """Plain values by name, the faults with the most pixels first; `docs/fusion.md` lists them."""
        return [entry.report() for entry in sorted(self._entries, key=lambda entry: -entry.worst.pixels)]


class _Entry:
    """A fault over some frames, described as in the one where it concerns most pixels."""

    def __init__(self, fault: MapFault, frame: int) -> None:
        self.latest = self.worst = fault
        self._first = self._last = self._worst_frame = frame
        self._n_frames = 1

    def add(self, fault: MapFault, frame: int) -> None:
        """The same fault in a later frame, or in another part of this one."""
        self._n_frames += frame != self._last
        self.latest, self._last = fault, frame
        if fault.pixels > self.worst.pixels:
            self.worst, self._worst_frame = fault, frame

    def report(self) -> dict[str, Any]:
        """Plain values by name."""
        worst = self.worst
        place = (
            {}
            if worst.rows is None or worst.columns is None
            else {
                "rows": list(worst.rows),
                "columns": list(worst.columns),
                "vertex": worst.vertex,
                "place": worst.place,
            }
        )
        return {
            "kind": worst.kind,
            "frames": [self._first, self._last],
            "n_frames": self._n_frames,
            "worst_frame": self._worst_frame,
            "view": worst.view,
            "pixels": worst.pixels,
            "offset_mm": 1000 * worst.offset_m,
            "scale": worst.scale,
            **place,
            "text": f"{self._when()}: {worst}",
        }

    def _when(self) -> str:
        if self._first == self._last:
            return f"frame {self._first}"
        if self._n_frames == self._last - self._first + 1:
            return f"frames {self._first}-{self._last}"
        return f"{self._n_frames} frames of {self._first}-{self._last}"


def _meet(one: tuple[int, int] | None, other: tuple[int, int] | None) -> bool:
    """Whether two spans have a number in common; those of whole maps have."""
    return one is None or other is None or (one[0] <= other[1] and other[0] <= one[1])


def _span(numbers: tuple[int, int]) -> str:
    return f"{numbers[0]}-{numbers[1]}"
