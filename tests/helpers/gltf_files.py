"""Small glTF files for tests, put together by hand."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


@dataclass
class GlbWriter:
    """A GLB whose arrays are added one by one, and whose other words are set in `header`."""

    header: dict[str, Any] = field(
        default_factory=lambda: {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "accessors": [],
            "bufferViews": [],
        }
    )
    binary: bytes = b""

    def array(self, values: Any, kind: str, **more: object) -> int:
        """Add (count, width) values as "f4", "u2" and so on; the number of their accessor."""
        table = np.asarray(values).astype(f"<{kind}").reshape(len(values), -1)
        at = len(self.header["accessors"])
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": table.nbytes}
        self.header["bufferViews"].append(view)
        accessor = {
            "bufferView": at,
            "componentType": _CODES[kind],
            "count": len(table),
            "type": _KINDS[table.shape[1]],
        }
        self.header["accessors"].append(accessor | more)
        self.binary += table.tobytes() + bytes(-table.nbytes % 4)
        return at

    def mesh(self, *primitives: dict[str, Any], **more: object) -> None:
        """Set the one mesh of the file."""
        self.header["meshes"] = [{"primitives": list(primitives)} | more]

    def write(self, path: Path) -> Path:
        """Write the file; the path again."""
        buffers = self.header.pop("buffers", [{"byteLength": len(self.binary)}])
        text = json.dumps(self.header | {"buffers": buffers}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path
