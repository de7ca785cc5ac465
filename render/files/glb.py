"""The container of glTF files, and what their header must be: GLB, or .gltf with its buffers inside or beside it.

The container and the header's words: glTF 2.0 specification, sections 3 to 5.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from render.errors import InputError, said_by

MOST = 50_000_000  # vertices and corners of all meshes, as often as nodes place them
_DEEPEST = 1000  # nodes from the scene to a mesh
# Extensions that leave places and texture coordinates as they are.
_LOOKS = (
    "KHR_materials_",
    "KHR_lights_",
    "EXT_lights_",
    "EXT_texture_",
    "KHR_texture_basisu",
    "MSFT_texture_dds",
)
_HARMLESS = ("KHR_xmp_json_ld", "KHR_animation_pointer")
WRONG = (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError, OverflowError)


@dataclass(frozen=True, eq=False)
class Document:
    """A glTF file: its header, and the bytes of its buffers; None for one of which there is only a packed copy."""

    header: dict[str, Any]
    buffers: list[memoryview | None]


def read_document(path: Path) -> Document:
    """Read and check a .glb or .gltf file.

    Raises:
        InputError: no glTF of version 2, a required extension that is not read, counts that the file has no room for,
            nodes in a circle, or buffers that are not there.
    """
    content = memoryview(path.read_bytes())
    text, binary = (content, None) if path.suffix.lower() == ".gltf" else _chunks(path, content)
    try:
        header = json.loads(bytes(text))
        _check_extensions(path, header)
        buffers = [
            _buffer(path, entry, None if number else binary)
            for number, entry in enumerate(header.get("buffers", []))
        ]
        _check_counts(path, header, len(content) + sum(len(buffer or b"") for buffer in buffers))
    except InputError:
        raise
    except WRONG as error:
        raise InputError(f"{path}: its header is not that of a GLB ({said_by(error)})") from error
    return Document(header, buffers)


def _chunks(path: Path, content: memoryview) -> tuple[memoryview, memoryview | None]:
    """The header's text, and the binary chunk, where there is one."""
    if len(content) < 20 or bytes(content[:4]) != b"glTF" or bytes(content[16:20]) != b"JSON":
        raise InputError(f"{path}: not a GLB file, which begins with glTF and its header")
    length = struct.unpack("<I", content[12:16])[0]
    rest = content[20 + length :]
    if bytes(rest[4:8]) != b"BIN\0":
        return content[20 : 20 + length], None
    return content[20 : 20 + length], rest[8 : 8 + struct.unpack("<I", rest[:4])[0]]


def _check_extensions(path: Path, header: dict[str, Any]) -> None:
    required = [str(name) for name in header.get("extensionsRequired", [])]
    strange = [name for name in required if not name.startswith(_LOOKS) and name not in _HARMLESS]
    if strange:
        raise InputError(
            f"{path}: requires the glTF extension {', '.join(strange)}, which is not read; export it without "
            "(no compression, quantisation or texture transforms)"
        )


def _buffer(path: Path, entry: dict[str, Any], binary: memoryview | None) -> memoryview | None:
    """The bytes of a buffer; None where only a packed copy is in the file.

    Args:
        binary: of the GLB, for its first buffer.
    """
    uri = entry.get("uri")
    if uri is None:
        if any(isinstance(one, dict) and one.get("fallback") for one in entry.get("extensions", {}).values()):
            return None
        content = binary or memoryview(b"")
    elif uri.startswith("data:"):
        try:
            content = memoryview(base64.b64decode(uri.split(",", 1)[1], validate=True))
        except binascii.Error as error:
            raise InputError(f"{path}: cannot be read: an embedded buffer is no base64 ({error})") from None
    else:
        beside = (path.parent / unquote(uri)).resolve()
        inside = beside.is_relative_to(path.parent.resolve()) and path.suffix.lower() == ".gltf"
        if not inside or not beside.is_file():
            raise InputError(
                f"{path}: its buffer '{uri}' cannot be read; it must be a file beside a .gltf, or inside a .glb"
            )
        content = memoryview(beside.read_bytes())
    if len(content) < int(entry["byteLength"]):
        raise InputError(
            f"{path}: cannot be read: a buffer of {entry['byteLength']} bytes has only {len(content)}"
        )
    return content


def _check_counts(path: Path, header: dict[str, Any], size: int) -> None:
    accessors = header.get("accessors", [])
    for number, accessor in enumerate(accessors):
        if not 0 <= int(accessor["count"]) <= size:
            raise InputError(
                f"{path}: accessor {number} counts {accessor['count']} values, more than the file has bytes"
            )
    nodes = header.get("nodes", [])
    _check_tree(path, nodes)
    sizes = [
        sum(_corners(part, accessors) for part in mesh["primitives"]) for mesh in header.get("meshes", [])
    ]
    total = sum(sizes[node["mesh"]] for node in nodes if "mesh" in node)
    if total > MOST:
        raise InputError(f"{path}: its nodes place {total} vertices and corners, at most {MOST} can be read")


def _corners(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    used = [primitive["attributes"].get("POSITION"), primitive.get("indices")]
    return sum(int(accessors[index]["count"]) for index in used if index is not None)


def _check_tree(path: Path, nodes: list[dict[str, Any]]) -> None:
    """Refuse nodes that are below themselves, or that hang from two others: no scene then."""
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parents.setdefault(int(child), number) != number or not 0 <= child < len(nodes):
                raise InputError(f"{path}: node {child} hangs from two others, or does not exist")
    for number in parents:
        above, steps = number, 0
        while above in parents:
            above, steps = parents[above], steps + 1
            if steps > _DEEPEST:
                raise InputError(
                    f"{path}: node {number} hangs from itself, or more than {_DEEPEST} nodes deep"
                )
