"""What a glTF file has beside what is read of it, in words for summaries."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from render.files.gltf_materials import colour_texture, image_name, image_of, inside_file

TRIANGLES = (4, 5, 6)  # modes of primitives: alone, in strips, in fans
_OTHER_TEXTURES = {
    "normalTexture": "normals",
    "occlusionTexture": "occlusion",
    "emissiveTexture": "emission",
    "metallicRoughnessTexture": "roughness",
}
_MOST_NAMES = 4


def left_out(header: dict[str, Any], shown: Iterable[int]) -> tuple[str, ...]:
    """A phrase for each thing that is not read, or not in full.

    Args:
        shown: numbers of the nodes of the scene that is read.
    """
    nodes = header.get("nodes", [])
    placed = [nodes[number] for number in sorted(shown) if "mesh" in nodes[number]]
    meshes = [header["meshes"][node["mesh"]] for node in placed]
    primitives = [primitive for mesh in meshes for primitive in mesh["primitives"]]
    return (
        *_motion(header, placed, primitives),
        *_others(header, placed, primitives),
        *_looks(header, sorted({part["material"] for part in primitives if "material" in part})),
    )


def _motion(
    header: dict[str, Any], placed: list[dict[str, Any]], primitives: list[dict[str, Any]]
) -> Iterable[str]:
    if header.get("animations"):
        names = [str(one.get("name", number)) for number, one in enumerate(header["animations"])]
        yield f"animations ({_some(names)}): one still frame is read"
    if any("skin" in node for node in placed):
        yield "the skin's joints: its mesh stands as they do in the file"
    if any(part.get("targets") for part in primitives):
        yield "morph targets: their weights are those of the file"


def _others(
    header: dict[str, Any], placed: list[dict[str, Any]], primitives: list[dict[str, Any]]
) -> Iterable[str]:
    loose = sum(part.get("mode", 4) not in TRIANGLES for part in primitives)
    if loose:
        yield f"{loose} primitives of points or lines"
    elsewhere = sum("mesh" in node for node in header.get("nodes", [])) - len(placed)
    if elsewhere:
        yield f"{elsewhere} meshes that are not in the scene"


def _looks(header: dict[str, Any], used: list[int]) -> Iterable[str]:
    images = dict.fromkeys(
        image for image in (image_of(header, number) for number in used) if image is not None
    )
    inside = [image_name(header, image) for image in images if inside_file(header["images"][image])]
    if inside:
        yield f"images inside the file (to have {_some(inside)} come along, put it beside the file)"
    if any(
        "KHR_texture_transform" in colour_texture(header, number).get("extensions", {}) for number in used
    ):
        yield "texture transforms"
    described = [header["materials"][number] for number in used]
    other = [
        word
        for name, word in _OTHER_TEXTURES.items()
        if any(name in one or name in one.get("pbrMetallicRoughness", {}) for one in described)
    ]
    if other:
        yield f"textures of {', '.join(other)}"


def _some(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more
