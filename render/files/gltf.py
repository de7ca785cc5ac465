"""Meshes of glTF files: every primitive with its corner texture coordinates and material, placed by the nodes.

Read here, because trimesh rewrites texture coordinates into an atlas where there are several materials, and drops them
where there is none. Facts of the format: glTF 2.0 specification, section 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError, said_by
from render.files.glb import WRONG, Document, read_document
from render.files.gltf_accessors import Accessors
from render.files.gltf_left_out import TRIANGLES, left_out
from render.files.gltf_materials import colour_texture, material_library
from render.files.gltf_pose import joint_transforms, morphed, nodes_of_scene, skinned, world_transforms
from render.mesh.mesh import Mesh
from render.mesh.surface import Surface

_ALONE, _STRIP, _FAN = TRIANGLES
_LARGEST_UV = 1e6  # repetitions of a texture


def read_gltf(path: Path) -> Mesh:
    """Read a .glb or .gltf file: the meshes of its scene in the order of their nodes, in world coordinates.

    Skinned meshes stand as their joints do in the file, and morph targets have the weights that it gives them. The
    mesh's `left_out` says what is not read. Primitives of a mesh that share their places share vertices.

    Returns:
        The mesh, with a surface where the file has texture coordinates or materials: names and plain colours, and
        images that are files under the folder.

    Raises:
        InputError: as `read_document` and `Mesh` raise, or data that do not fit each other, are sparse or not there.
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
    """What nodes have placed so far; a part of the faces, their texture corners and their material a primitive."""

    n_vertices: int = 0
    n_uvs: int = 0
    vertices: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    uvs: list[np.ndarray] = field(default_factory=list)
    uv_faces: list[np.ndarray | None] = field(default_factory=list)
    materials: list[int] = field(default_factory=list)


class _Reader:
    def __init__(self, path: Path, document: Document) -> None:
        self.path, self.header = path, document.header
        self.accessors = Accessors(path, document)
        self.nodes: list[dict[str, Any]] = self.header.get("nodes", [])
        self.placed = world_transforms(self.nodes)
        self.parts = _Parts()

    def mesh(self) -> Mesh:
        shown = set(range(len(self.nodes)))
        if self.header.get("scenes"):
            shown = nodes_of_scene(self.header, self.header.get("scene", 0))
        for number in sorted(shown):
            if "mesh" in self.nodes[number]:
                self._add(number)
        vertices = _joined(self.parts.vertices, np.zeros((0, 3)))
        faces = _joined(self.parts.faces, np.zeros((0, 3), np.int64))
        surface = self._surface(faces, len(vertices))
        return Mesh(vertices, faces, str(self.path), surface, left_out=left_out(self.header, shown))

    def _add(self, number: int) -> None:
        """Add the mesh of a node."""
        node = self.nodes[number]
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise InputError(
                f"{self.path}: node {number} repeats its mesh by EXT_mesh_gpu_instancing, which is not read; "
                "export real copies"
            )
        mesh, place = self.header["meshes"][node["mesh"]], self.placed[number]
        weights = node.get("weights", mesh.get("weights", []))
        skin = None
        if "skin" in node:
            skin = joint_transforms(self.accessors, self.header["skins"][node["skin"]], self.placed)
        begins: dict[object, int] = {}  # of the vertices that primitives share
        for primitive in mesh["primitives"]:
            mode, attributes = primitive.get("mode", _ALONE), primitive["attributes"]
            if mode not in TRIANGLES or "POSITION" not in attributes:
                continue
            transforms = skin if "JOINTS_0" in attributes else None
            key = _key(primitive)
            if key not in begins:
                begins[key] = self.parts.n_vertices
                vertices = morphed(self.accessors, primitive, weights)
                self.parts.n_vertices += len(vertices)
                self.parts.vertices.append(self._in_world(vertices, attributes, place, transforms))
            turned = np.linalg.det((place if transforms is None else transforms)[..., :3, :3]).sum() < 0
            self._add_faces(primitive, mode, begins[key], turned=turned)

    def _in_world(
        self, vertices: np.ndarray, attributes: dict[str, int], place: np.ndarray, skin: np.ndarray | None
    ) -> np.ndarray:
        if skin is not None:
            return skinned(self.accessors, attributes, vertices, skin)
        if np.array_equal(place, np.eye(4)):
            return vertices
        vertices = vertices @ place[:3, :3].T
        vertices += place[:3, 3]
        return vertices

    def _add_faces(self, primitive: dict[str, Any], mode: int, begin: int, *, turned: bool) -> None:
        """Add the faces of a primitive whose vertices begin at a number; `turned` mirrors them, as glTF wants it."""
        count = self.accessors.count(primitive["attributes"]["POSITION"])
        if "indices" in primitive:
            order = self.accessors.whole_numbers(primitive["indices"], "SCALAR", below=count)[:, 0]
        else:
            order = np.arange(count)
        corners = _triangles(order, mode)
        if turned:
            corners = corners[:, ::-1]
        faces = corners + begin if begin else corners
        self.parts.faces.append(faces)
        self.parts.uv_faces.append(self._uv_faces(primitive, corners, count, faces, begin))
        self.parts.materials.append(int(primitive.get("material", -1)))

    def _uv_faces(
        self, primitive: dict[str, Any], corners: np.ndarray, count: int, faces: np.ndarray, begin: int
    ) -> np.ndarray | None:
        """The texture corners of a primitive; None where it has no texture coordinates."""
        colour = colour_texture(self.header, primitive.get("material"))
        accessor = primitive["attributes"].get(f"TEXCOORD_{colour.get('texCoord', 0)}")
        if accessor is None:
            return None
        normalised = self.header["accessors"][accessor].get("normalized", False)  # more digits until 1 - v
        uvs = self.accessors.values(accessor, "VEC2", np.float64 if normalised else np.float32)
        within = not uvs.size or (uvs.min() >= -_LARGEST_UV and uvs.max() <= _LARGEST_UV)  # NaN is neither
        if len(uvs) != count or not within:
            raise InputError(f"{self.path}: texture coordinates that are no numbers, or not one a vertex")
        np.subtract(1, uvs[:, 1], out=uvs[:, 1])  # glTF counts from the image's top
        offset = self.parts.n_uvs
        self.parts.uvs.append(uvs.astype(np.float32, copy=False))
        self.parts.n_uvs += count
        return faces if offset == begin else corners + offset

    def _surface(self, faces: np.ndarray, n_vertices: int) -> Surface | None:
        parts = self.parts
        counts = [len(part) for part in parts.faces]
        used = list(dict.fromkeys(number for number, n in zip(parts.materials, counts, strict=True) if n))
        if not len(faces) or not (parts.uvs or max(used) >= 0):
            return None
        names, mtl = material_library(self.header, used, self.path.parent)
        numbers = [used.index(number) if number in used else 0 for number in parts.materials]
        return Surface(
            faces,
            np.arange(n_vertices),
            uvs=_joined(parts.uvs, np.zeros((0, 2), np.float32)) if parts.uvs else None,
            uv_faces=self._joined_uv_faces(faces) if parts.uvs else None,
            face_materials=np.repeat(numbers, counts) if mtl else None,
            materials=names,
            mtl=mtl,
        )

    def _joined_uv_faces(self, faces: np.ndarray) -> np.ndarray:
        """(F, 3) texture corners of all faces, -1 where there are none; `faces` themselves where they are the same."""
        parts = list(zip(self.parts.uv_faces, self.parts.faces, strict=True))
        if all(uv_faces is own for uv_faces, own in parts):
            return faces
        return np.concatenate([np.full_like(own, -1) if one is None else one for one, own in parts])


def _key(primitive: dict[str, Any]) -> object:
    """What is the same for primitives of one mesh whose vertices are the same."""
    attributes = {
        name: number
        for name, number in primitive["attributes"].items()
        if name == "POSITION" or name.startswith(("JOINTS_", "WEIGHTS_"))
    }
    targets = [target.get("POSITION") for target in primitive.get("targets", [])]
    return *sorted(attributes.items()), *targets


def _joined(parts: list[np.ndarray], nothing: np.ndarray) -> np.ndarray:
    """The parts one after the other; a single one without a copy."""
    return parts[0] if len(parts) == 1 else np.concatenate([nothing, *parts])


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    """(F, 3) corners of triangles, of a strip, or of a fan."""
    if mode == _ALONE:
        return order.reshape(-1, 3)
    count = max(len(order) - 2, 0)
    if mode == _FAN:
        return np.stack([np.repeat(order[:1], count), order[1 : count + 1], order[2 : count + 2]], axis=-1)
    strip = np.stack([order[:count], order[1 : count + 1], order[2 : count + 2]], axis=-1)
    strip[1::2] = strip[1::2][:, [1, 0, 2]]  # every other triangle is seen from behind
    return strip
