"""What a material library says that other formats can say, too: colour, opacity and the colour's image."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.exports.objects import COLOURS
from render.files.mtl import textures
from render.files.textures import is_image
from render.mesh.surface import Surface

IMAGES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
"""Images that glTF 2.0 and USD's preview surface both admit, by ending, with their media types."""


@dataclass(frozen=True)
class Material:
    """A material in plain words.

    Args:
        name: as the library has it.
        colour: linear RGB, None where the library does not describe it.
        opacity: 1 is opaque. image: of the colour, which takes the colour's place.
    """

    name: str
    colour: tuple[float, float, float] | None
    opacity: float = 1.0
    image: Path | None = None


def material_of(name: str, mtl: str) -> Material:
    """One material of an MTL library (`Kd`, `d`, `Tr`, `map_Kd`); without colour where it is not described."""
    block = re.search(rf"^newmtl\s+{re.escape(name)}\s*$(.*?)(?=^newmtl|\Z)", mtl, re.MULTILINE | re.DOTALL)
    text = block[1] if block else ""
    colour = _numbers(text, "Kd", 3)
    colour = colour * 3 if len(colour) == 1 else colour  # one number is all three
    opacity = _numbers(text, "d", 1) or [1 - value for value in _numbers(text, "Tr", 1)] or [1.0]
    images = textures(text)
    path = Path(images[0]) if images else None
    if path is not None and (path.suffix.lower() not in IMAGES or not is_image(path)):
        path = None
    return Material(name, (colour[0], colour[1], colour[2]) if len(colour) == 3 else None, opacity[0], path)


def parts_of(name: str, surface: Surface) -> list[tuple[Material, np.ndarray]]:
    """Each material that has faces, and the numbers of its faces, (f,) int64.

    Args:
        name: of the object, and of its one material where the file names none.
    """
    if surface.face_materials is None:
        return [(Material(name, COLOURS[name][:3]), np.arange(len(surface.faces)))]
    numbered = (
        (material_of(used, surface.mtl), np.flatnonzero(surface.face_materials == number))
        for number, used in enumerate(surface.materials)
    )
    return [(material, faces) for material, faces in numbered if len(faces)]


def _numbers(text: str, keyword: str, count: int) -> list[float]:
    line = re.search(rf"^\s*{keyword}\s+(.+)$", text, re.MULTILINE)
    try:
        return [float(word) for word in line[1].split()[:count]] if line else []
    except ValueError:
        return []
