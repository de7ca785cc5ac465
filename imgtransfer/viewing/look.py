"""What the page has been asked to show of its frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from imgtransfer.viewing.colours import Colours
from imgtransfer.viewing.picking import Mark

Maps = Literal["none", "normals", "positions"]
MAPS: tuple[Maps, ...] = ("none", "normals", "positions")
COLOURS: tuple[Colours, ...] = ("cloth", "error", "strain")


@dataclass(frozen=True)
class Look:
    """How frames are drawn.

    Args:
        colours: of the garments.
        limit: what the last colour stands for, in the colours' unit.
        crossings: whether edges that pass through something are marked.
        maps: which maps stand beside the meshes.
        in_place: whether the body's way over the floor is taken out.
        mark: a point of the garments that is marked, and its pixels with it.
    """

    colours: Colours = "cloth"
    limit: float = 1.0
    crossings: bool = False
    maps: Maps = "none"
    in_place: bool = True
    mark: Mark | None = None
