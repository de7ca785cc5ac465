"""Meshes from files, with the vertices in the file's order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError
from render.mesh import Mesh

SUFFIXES = (".obj", ".ply", ".glb", ".stl")


def load_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh.

    OBJ: its own `v` order is kept, vertices that no face uses and texture seams change nothing, polygons
    become fans.
    PLY: likewise. GLB: the scene's meshes one after the other, placed by their nodes. STL knows no shared
    vertices: corners at the same place become one vertex.

    Args:
        path: a file whose name ends in .obj, .ply, .glb or .stl; metres, y up.

    Raises:
        InputError: no such file, another format, content that cannot be read, or a mesh that `Mesh` refuses.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a mesh must be one of {', '.join(SUFFIXES)}, found '{suffix}'")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    vertices, faces = _read_obj(path) if suffix == ".obj" else _read_other(path)
    if suffix == ".stl":
        vertices, merged = np.unique(vertices, axis=0, return_inverse=True)
        faces = merged.reshape(-1)[faces]
    return Mesh(vertices, faces, source=str(path))


def _read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of an OBJ file; trimesh reorders, splits and drops vertices, which we must not."""
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        keyword, *words = line.split("#", 1)[0].split() or [""]
        try:
            if keyword == "v":
                x, y, z = (float(word) for word in words[:3])  # a weight or a colour may follow
                vertices.append([x, y, z])
            elif keyword == "f":
                corners = [_obj_index(word.split("/")[0], len(vertices)) for word in words]
                if len(corners) < 3:
                    raise ValueError
                faces.extend([corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1))
        except ValueError:
            raise InputError(
                f"{path}: line {number} is not a valid vertex or face: '{line.strip()}'"
            ) from None
    return np.array(vertices, np.float64).reshape(-1, 3), np.array(faces, np.int64).reshape(-1, 3)


def _obj_index(word: str, n_vertices: int) -> int:
    """OBJ counts from 1, and from -1 backwards from the latest vertex; 0 stays invalid (-1)."""
    index = int(word)
    return index - 1 if index >= 0 else n_vertices + index


def _read_other(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # noqa: PLC0415  (half a second that most callers need not pay)

    try:
        loaded: Any = trimesh.load(path, process=False)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
        return np.array(loaded.vertices), np.array(getattr(loaded, "faces", np.zeros((0, 3), np.int64)))
    except Exception as error:  # its readers raise whatever they meet
        raise InputError(f"{path}: cannot be read as {path.suffix.lower()} ({error})") from error
