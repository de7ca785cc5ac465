"""What a GLB must be before trimesh reads it, which makes room for whatever its header counts.

The container and the header's words: glTF 2.0 specification, sections 4.4 and 5.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from render.errors import InputError, said_by

MOST = 50_000_000  # vertices and corners of all meshes, as often as nodes place them
_DEEPEST = 1000  # nodes from the scene to a mesh


def check_glb(path: Path, content: bytes) -> None:
    """Check a GLB's header.

    Args:
        path: for messages. content: of the file.

    Raises:
        InputError: no GLB of version 2, a header that is none, counts that the file has no room for, or nodes in a
            circle.
    """
    if len(content) < 20 or content[:4] != b"glTF" or content[16:20] != b"JSON":
        raise InputError(f"{path}: not a GLB file, which begins with glTF and its header")
    length = struct.unpack("<I", content[12:16])[0]
    try:
        header = json.loads(content[20 : 20 + length])
        accessors = header.get("accessors", [])
        for number, accessor in enumerate(accessors):
            if not 0 <= int(accessor["count"]) <= len(content):
                raise InputError(
                    f"{path}: accessor {number} counts {accessor['count']} values, more than the file has bytes"
                )
        nodes = header.get("nodes", [])
        _check_tree(path, nodes)
        sizes = [
            sum(_corners(part, accessors) for part in mesh["primitives"]) for mesh in header.get("meshes", [])
        ]
        total = sum(sizes[node["mesh"]] for node in nodes if "mesh" in node)
    except InputError:
        raise
    except (
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        AttributeError,
        RecursionError,
        OverflowError,
    ) as error:
        raise InputError(f"{path}: its header is not that of a GLB ({said_by(error)})") from error
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
