"""Materials of glTF files as a material library: colour, opacity, and images of the base colour."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote

from render.files.textures import IMAGES, with_full_paths


def colour_texture(header: dict[str, Any], material: int | None) -> dict[str, Any]:
    """The reference to the texture of a material's base colour; empty where it has none."""
    described = {} if material is None else header["materials"][material]
    texture: dict[str, Any] = described.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    return texture


def material_library(header: dict[str, Any], used: list[int], folder: Path) -> tuple[tuple[str, ...], str]:
    """Names that differ, and the library; -1 is what has no material, and "" the library where nothing has one.

    Args:
        used: numbers of materials. folder: of the file, under which its images lie.
    """
    if used == [-1]:
        return (), ""
    names, text = [], []
    for number in used:
        described = {} if number < 0 else header["materials"][number]
        name = " ".join(str(described.get("name", "default" if number < 0 else "")).split())
        name = name or f"material_{number}"
        names.append(name if name not in names else f"{name}-{number}")
        text.append(f"newmtl {names[-1]}\n")
        if number >= 0:
            text += _look(header, number)
    return tuple(names), with_full_paths("".join(text), folder)


def image_of(header: dict[str, Any], material: int | None) -> int | None:
    """The number of the image of a material's base colour, which an extension (WebP, KTX) may name."""
    number = colour_texture(header, material).get("index")
    if number is None:
        return None
    texture = header["textures"][number]
    named = [texture, *texture.get("extensions", {}).values()]
    return next((one["source"] for one in named if "source" in one), None)


def inside_file(image: dict[str, Any]) -> bool:
    """Whether an image is a part of the file."""
    return "uri" not in image or str(image["uri"]).startswith("data:")


def image_name(header: dict[str, Any], number: int) -> str:
    """The path of an image beside the file; for one inside the file the name it would have there."""
    image = header["images"][number]
    if not inside_file(image):
        return " ".join(unquote(str(image["uri"])).splitlines())
    name = Path(" ".join(str(image.get("name", "")).split()).replace("\\", "/")).name or f"image_{number}"
    kind = str(image.get("mimeType") or str(image.get("uri", ""))[5:].split(";")[0]).rpartition("/")[2]
    suffix = ".jpg" if kind == "jpeg" else f".{kind}"
    return name if Path(name).suffix.lower() in IMAGES or suffix not in IMAGES else name + suffix


def _look(header: dict[str, Any], number: int) -> list[str]:
    described = header["materials"][number].get("pbrMetallicRoughness", {})
    *colour, opacity = map(float, described.get("baseColorFactor", [1] * 4))
    lines = [f"Kd {' '.join(f'{value:.8g}' for value in colour)}\n", f"d {opacity:.8g}\n"]
    image = image_of(header, number)
    return lines if image is None else [*lines, f"map_Kd {image_name(header, image)}\n"]
