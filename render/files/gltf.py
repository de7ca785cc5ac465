"""Meshes of glTF files: every primitive with its corner texture coordinates and material, placed by the nodes.

Read here, because trimesh rewrites texture coordinates into an atlas where there are several materials, and drops them
where there is none. Facts of the format: glTF 2.0 specification, section 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from render.errors import InputError, said_by
from render.files.glb import WRONG, Document, read_document
from render.files.textures import with_full_paths
from render.mesh.surface import Surface

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_LARGEST_UV = 1e6  # repetitions of a texture


def read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    """Read a .glb or .gltf file: the meshes of its scene in the order of their nodes, in world coordinates.

    Points and lines are passed over, as are skins, morph targets and animations. Primitives of a mesh that share their
    places share vertices.

    Returns:
        Vertices (N, 3) float64, faces (F, 3) int64, and the surface where the file has texture coordinates or
        materials: names and plain colours, and images that are files under the folder.

    Raises:
        InputError: as `read_document` raises, or data that do not fit each other, are sparse or not there.
    """
    document = read_document(path)
    try:
        return _Reader(path, document).mesh()
    except InputError:
        raise
    except WRONG as error:
        raise InputError(f"{path}: cannot be read as {path.suffix.lower()} ({said_by(error)})") from error


@dataclass(eq=False)
class _Parts:
    """What nodes have placed so far."""

    count: int = 0
    vertices: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    uvs: list[np.ndarray] = field(default_factory=list)
    uv_faces: list[np.ndarray] = field(default_factory=list)
    materials: list[np.ndarray] = field(default_factory=list)


class _Reader:
    def __init__(self, path: Path, document: Document) -> None:
        self.path, self.header, self.buffers = path, document.header, document.buffers

    def mesh(self) -> tuple[np.ndarray, np.ndarray, Surface | None]:
        parts = _Parts()
        nodes = self.header.get("nodes", [])
        places = self._places(nodes)
        for number, node in enumerate(nodes):
            if number in places and "mesh" in node:
                if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                    raise InputError(
                        f"{self.path}: node {number} repeats its mesh by EXT_mesh_gpu_instancing, which is not read; "
                        "export real copies"
                    )
                self._add(parts, self.header["meshes"][node["mesh"]], places[number])
        vertices = np.concatenate([np.zeros((0, 3)), *parts.vertices])
        faces = np.concatenate([np.zeros((0, 3), np.int64), *parts.faces])
        return vertices, faces, self._surface(parts, faces, len(vertices))

    def _places(self, nodes: list[dict[str, Any]]) -> dict[int, np.ndarray]:
        """The (4, 4) world transform of every node of the scene."""
        scenes = self.header.get("scenes")
        below = {int(child) for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in below]
        if scenes:
            roots = scenes[self.header.get("scene", 0)].get("nodes", [])
        places: dict[int, np.ndarray] = {}
        waiting = [(int(root), np.eye(4)) for root in roots]
        while waiting:
            number, above = waiting.pop()
            places[number] = above @ _transform(nodes[number])
            waiting += [(int(child), places[number]) for child in nodes[number].get("children", [])]
        return places

    def _add(self, parts: _Parts, mesh: dict[str, Any], place: np.ndarray) -> None:
        at: dict[int, int] = {}  # where the vertices of an accessor begin
        for primitive in mesh["primitives"]:
            mode, attributes = primitive.get("mode", _TRIANGLES), primitive["attributes"]
            if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
                continue
            position = attributes["POSITION"]
            count = int(self.header["accessors"][position]["count"])
            if position not in at:
                at[position] = parts.count
                parts.vertices.append(self._values(position, "VEC3") @ place[:3, :3].T + place[:3, 3])
                parts.count += count
            order = (
                self._values(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
                if "indices" in primitive
                else np.arange(count)
            )
            if len(order) and order.max() >= count:
                raise InputError(f"{self.path}: a primitive uses vertex {order.max()} of {count}")
            corners = _triangles(order, mode)
            if np.linalg.det(place[:3, :3]) < 0:  # mirrored: glTF turns the triangles round
                corners = corners[:, ::-1]
            parts.faces.append(corners + at[position])
            parts.uv_faces.append(self._uv_faces(parts, primitive, corners, count))
            parts.materials.append(np.full(len(corners), primitive.get("material", -1)))

    def _uv_faces(
        self, parts: _Parts, primitive: dict[str, Any], corners: np.ndarray, count: int
    ) -> np.ndarray:
        colour = self._colour_texture(primitive.get("material"))
        accessor = primitive["attributes"].get(f"TEXCOORD_{colour.get('texCoord', 0)}")
        if accessor is None:
            return np.full_like(corners, -1)
        uvs = self._values(accessor, "VEC2")
        if len(uvs) != count or not (np.abs(uvs) <= _LARGEST_UV).all():
            raise InputError(f"{self.path}: texture coordinates that are no numbers, or not one a vertex")
        offset = sum(len(part) for part in parts.uvs)
        parts.uvs.append(np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=-1))  # glTF counts from the image's top
        return corners + offset

    def _values(self, number: int, kind: str) -> np.ndarray:
        """(count, width) float64 of an accessor."""
        accessor = self.header["accessors"][number]
        if "sparse" in accessor:
            raise InputError(
                f"{self.path}: accessor {number} is sparse, which is not read; export it in full"
            )
        if "bufferView" not in accessor:
            used = ", ".join(self.header.get("extensionsUsed", [])) or "no extension"
            raise InputError(f"{self.path}: accessor {number} has no data here (the file uses {used})")
        if accessor["type"] != kind:
            raise InputError(f"{self.path}: accessor {number} is {accessor['type']}, not {kind}")
        view = self.header["bufferViews"][accessor["bufferView"]]
        strange = [name for name in view.get("extensions", {}) if "compression" in name]
        if strange:
            raise InputError(
                f"{self.path}: is compressed by {strange[0]}, which is not read; export it without"
            )
        dtype, width, count = (
            np.dtype(_TYPES[accessor["componentType"]]),
            _WIDTHS[kind],
            int(accessor["count"]),
        )
        stride = int(view.get("byteStride") or dtype.itemsize * width)
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        inside = int(accessor.get("byteOffset", 0))
        buffer = self.buffers[view["buffer"]]
        needed = inside + stride * (count - 1) + dtype.itemsize * width if count else 0
        if min(start, inside, stride) < 0 or needed > length or start + length > len(buffer):
            raise InputError(
                f"{self.path}: accessor {number} reaches beyond its buffer: the file is cut or wrong"
            )
        if not count:
            return np.zeros((0, width))
        table = np.ndarray((count, width), dtype, buffer, start + inside, (stride, dtype.itemsize))
        values = table.astype(np.float64)
        if accessor.get("normalized", False):
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _colour_texture(self, material: int | None) -> dict[str, Any]:
        described = {} if material is None else self.header["materials"][material]
        texture: dict[str, Any] = described.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        return texture

    def _surface(self, parts: _Parts, faces: np.ndarray, n_vertices: int) -> Surface | None:
        numbers = np.concatenate([np.zeros(0, np.int64), *parts.materials])
        if not len(faces) or not (parts.uvs or (numbers >= 0).any()):
            return None
        used = [int(number) for number in dict.fromkeys(numbers.tolist())]  # in the order of their first use
        names, mtl = self._materials(used)
        return Surface(
            faces,
            np.arange(n_vertices),
            uvs=np.concatenate(parts.uvs).astype(np.float32) if parts.uvs else None,
            uv_faces=np.concatenate(parts.uv_faces) if parts.uvs else None,
            face_materials=np.array([used.index(number) for number in numbers]) if mtl else None,
            materials=names if mtl else (),
            mtl=mtl,
        )

    def _materials(self, used: list[int]) -> tuple[tuple[str, ...], str]:
        """Names that differ, and the library; -1 is what has no material, and "" the library where nothing has one."""
        if used == [-1]:
            return (), ""
        names, text = [], []
        for number in used:
            described = {} if number < 0 else self.header["materials"][number]
            name = " ".join(str(described.get("name", "default" if number < 0 else "")).split())
            name = name or f"material_{number}"
            names.append(name if name not in names else f"{name}-{number}")
            text.append(f"newmtl {names[-1]}\n")
            if number >= 0:
                text += self._look(described, number)
        return tuple(names), with_full_paths("".join(text), self.path.parent)

    def _look(self, described: dict[str, Any], number: int) -> list[str]:
        *colour, opacity = map(
            float, described.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1] * 4)
        )
        lines = [f"Kd {' '.join(f'{value:.8g}' for value in colour)}\n", f"d {opacity:.8g}\n"]
        texture = self._colour_texture(number).get("index")
        source = None if texture is None else self.header["textures"][texture].get("source")
        uri = None if source is None else self.header["images"][source].get("uri")
        if uri is not None and not uri.startswith("data:"):
            lines.append(f"map_Kd {' '.join(unquote(uri).splitlines())}\n")
        return lines


def _transform(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # stored by columns
    x, y, z, w = (float(value) for value in node.get("rotation", (0, 0, 0, 1)))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    placed = np.eye(4)
    placed[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64)
    placed[:3, 3] = node.get("translation", (0, 0, 0))
    return placed


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    """(F, 3) corners of triangles, of a strip, or of a fan."""
    if mode == _TRIANGLES:
        return order.reshape(-1, 3)
    count = max(len(order) - 2, 0)
    if mode == _FAN:
        return np.stack([np.repeat(order[:1], count), order[1 : count + 1], order[2 : count + 2]], axis=-1)
    strip = np.stack([order[:count], order[1 : count + 1], order[2 : count + 2]], axis=-1)
    strip[1::2] = strip[1::2][:, [1, 0, 2]]  # every other triangle is seen from behind
    return strip
