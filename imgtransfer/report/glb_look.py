"""Texture coordinates and materials of a template for glTF, which wants one coordinate a vertex."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from render.files.mtl import textures
from render.files.textures import is_image
from render.mesh.surface import Surface

_MIME = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}  # what glTF 2.0 admits


@dataclass(frozen=True, eq=False)
class Seamed:
    """A mesh cut at its texture seams.

    Args:
        vertices: (K,) the template's vertex behind each vertex; the file's own come first, in its order.
        faces: (F, 3) int64.
        uvs: (K, 2) float32 with v downwards, as glTF has it; None where there are none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uvs: np.ndarray | None


def cut_at_seams(surface: Surface) -> Seamed:
    """Give every vertex one texture coordinate: further ones get copies of the vertex behind all others."""
    if surface.uvs is None or surface.uv_faces is None:
        return Seamed(surface.vertices, surface.faces, None)
    corners = np.stack([surface.faces.reshape(-1), surface.uv_faces.reshape(-1)], axis=1)
    pairs, pair_of_corner = np.unique(corners, axis=0, return_inverse=True)
    count = len(surface.vertices)
    first = np.ones(len(pairs), bool)  # of the vertex; pairs are sorted by it
    first[1:] = pairs[1:, 0] != pairs[:-1, 0]
    place = np.where(first, pairs[:, 0], count + np.cumsum(~first) - 1)
    vertices = np.concatenate([np.arange(count), pairs[~first, 0]])
    uvs = np.zeros((len(vertices), 2), np.float32)
    with_uv = pairs[:, 1] >= 0
    uvs[place[with_uv]] = surface.uvs[pairs[with_uv, 1]] * np.array([1, -1], np.float32) + np.array(
        [0, 1], np.float32
    )
    return Seamed(surface.vertices[vertices], place[pair_of_corner.reshape(-1)].reshape(-1, 3), uvs)


def material(name: str, mtl: str, default: tuple[float, ...]) -> tuple[dict[str, Any], Path | None]:
    """The glTF material for one of an MTL library (`Kd`, `d`, `Tr`, `map_Kd`), and its image if there is one.

    Args:
        name: of the material. mtl: the library's text.
        default: RGBA colour for materials that the library does not describe.
    """
    block = re.search(rf"^newmtl\s+{re.escape(name)}\s*$(.*?)(?=^newmtl|\Z)", mtl, re.MULTILINE | re.DOTALL)
    text = block[1] if block else ""
    colour = _numbers(text, "Kd", 3)
    colour = colour * 3 if len(colour) == 1 else colour if len(colour) == 3 else []  # one number is all three
    opacity = _numbers(text, "d", 1) or [1 - value for value in _numbers(text, "Tr", 1)] or [1.0]
    images = textures(text)
    path = Path(images[0]) if images else None
    if path is not None and (path.suffix.lower() not in _MIME or not is_image(path)):
        path = None
    surface = {
        "baseColorFactor": [1.0, 1.0, 1.0, opacity[0]]
        if path is not None
        else [*colour, opacity[0]]
        if colour
        else list(default),
        "metallicFactor": 0.0,
        "roughnessFactor": 0.85,
    }
    described: dict[str, Any] = {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True}
    if opacity[0] < 1:
        described["alphaMode"] = "BLEND"
    return described, path


def mime_type(image: Path) -> str:
    """The media type of an image that `material` found."""
    return _MIME[image.suffix.lower()]


def _numbers(text: str, keyword: str, count: int) -> list[float]:
    line = re.search(rf"^\s*{keyword}\s+(.+)$", text, re.MULTILINE)
    try:
        return [float(word) for word in line[1].split()[:count]] if line else []
    except ValueError:
        return []
