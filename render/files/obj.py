"""Wavefront OBJ: its own vertex order, texture coordinates and materials.

Read here, because trimesh reorders, splits and drops vertices. Facts of the format: Wavefront, "Object Files (.obj)",
appendix B of the Advanced Visualizer manual; the MTL library's `map_*` statements name texture images.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.textures import with_full_paths
from render.mesh.surface import Surface

_LARGEST_INDEX = 2**31  # beyond it no file has vertices
_LARGEST_UV = 1e6  # repetitions of a texture


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    """Read an OBJ file; polygons become fans, vertices that no face uses stay.

    Args:
        path: the file; material libraries and textures are looked for beside it.

    Returns:
        Vertices (N, 3) float64, faces (F, 3) int64, and the surface where the file has texture coordinates or
        materials. Indices out of range are not checked here.

    Raises:
        InputError: a line that is no valid vertex, texture coordinate or face, or texture indices out of range.
    """
    lines = _Lines()
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        keyword, *words = line.split("#", 1)[0].split() or [""]
        try:
            lines.add(keyword, words)
        except ValueError:
            what = "texture coordinate" if keyword == "vt" else "vertex or face"
            raise InputError(f"{path}: line {number} is not a valid {what}: '{line.strip()[:80]}'") from None
    vertices = np.array(lines.vertices, np.float64).reshape(-1, 3)
    faces = np.array(lines.faces, np.int64).reshape(-1, 3)
    return vertices, faces, _surface(path, lines, faces, len(vertices))


@dataclass
class _Lines:
    """What was read so far; every face knows the material in force."""

    vertices: list[list[float]] = field(default_factory=list)
    uvs: list[list[float]] = field(default_factory=list)
    faces: list[list[int]] = field(default_factory=list)
    uv_faces: list[list[int]] = field(default_factory=list)
    face_materials: list[int] = field(default_factory=list)
    materials: dict[str, int] = field(
        default_factory=dict
    )  # numbers by name, in the order of their first use
    libraries: dict[str, None] = field(default_factory=dict)  # each once, in their order
    current: int = -1

    def add(self, keyword: str, words: list[str]) -> None:
        """Take in one line; ValueError where it cannot be read."""
        if keyword == "v":
            x, y, z = (float(word) for word in words[:3])  # a weight or a colour may follow
            self.vertices.append([x, y, z])
        elif keyword == "vt":
            u, v = (float(word) for word in (*words[:2], *["0"] * (2 - len(words))))
            if not (abs(u) <= _LARGEST_UV and abs(v) <= _LARGEST_UV):
                raise ValueError
            self.uvs.append([u, v])
        elif keyword == "f":
            self._add_face(words)
        elif keyword == "usemtl":
            name = " ".join(words) or "material"
            self.current = self.materials.setdefault(name, len(self.materials))
        elif keyword == "mtllib":
            self.libraries[" ".join(words)] = None

    def _add_face(self, words: list[str]) -> None:
        parts = [word.split("/") for word in words]
        corners = [_index(part[0], len(self.vertices)) for part in parts]
        if len(corners) < 3:
            raise ValueError
        uvs = [_index(part[1], len(self.uvs)) if len(part) > 1 and part[1] else -1 for part in parts]
        if -1 in uvs:
            uvs = [-1] * len(uvs)
        for k in range(1, len(corners) - 1):
            self.faces.append([corners[0], corners[k], corners[k + 1]])
            self.uv_faces.append([uvs[0], uvs[k], uvs[k + 1]])
            self.face_materials.append(self.current)


def _index(word: str, count: int) -> int:
    """OBJ counts from 1, and from -1 backwards from the latest; 0 stays invalid (-1)."""
    index = int(word)
    if abs(index) > _LARGEST_INDEX:
        raise ValueError
    return index - 1 if index >= 0 else count + index


def _surface(path: Path, lines: _Lines, faces: np.ndarray, n_vertices: int) -> Surface | None:
    uv_faces = np.array(lines.uv_faces, np.int64).reshape(-1, 3)
    with_uvs, with_materials = bool((uv_faces >= 0).any()), bool(lines.materials)
    if not len(faces) or faces.min() < 0 or faces.max() >= n_vertices or not (with_uvs or with_materials):
        return None
    if uv_faces.max() >= len(lines.uvs) or uv_faces.min() < -1:
        worst = uv_faces.max() + 1 if uv_faces.max() >= len(lines.uvs) else uv_faces.min() - len(lines.uvs)
        raise InputError(f"{path}: faces use texture coordinate {worst}, but only 1..{len(lines.uvs)} exist")
    materials, used = list(lines.materials), np.array(lines.face_materials, np.int64)
    if with_materials and (used < 0).any():  # faces before the first usemtl
        used[used < 0] = len(materials)
        materials.append("default")
    return Surface(
        faces,
        np.arange(n_vertices),
        uvs=np.array(lines.uvs, np.float32).reshape(-1, 2) if with_uvs else None,
        uv_faces=uv_faces if with_uvs else None,
        face_materials=used if with_materials else None,
        materials=tuple(materials) if with_materials else (),
        mtl="".join(_library(path.parent / name, path.parent) for name in lines.libraries)
        if with_materials
        else "",
    )


def _library(path: Path, folder: Path) -> str:
    """The text of a material library with full paths to the textures in the mesh's folder; "" where it is missing.

    Only files that are named as libraries are read: an OBJ file may name any file.
    """
    if path.suffix.lower() != ".mtl" or not path.is_file():
        return ""
    return with_full_paths(path.read_text(errors="replace"), folder)


def textures(mtl: str, keyword: str = "map_Kd") -> list[str]:
    """The images that a material library's lines of a keyword name, each once; full paths may have spaces."""
    images = []
    for line in mtl.splitlines():
        first, *words = line.split() or [""]
        tails = [" ".join(words[start:]) for start in range(len(words))]
        if first == keyword and words:
            images.append(next((tail for tail in tails if Path(tail).is_absolute()), words[-1]))
    return list(dict.fromkeys(images))
