"""Meshes from files, with the vertices in the file's order."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError, said_by
from render.files.atomic import check_regular
from render.files.gltf import read_gltf
from render.files.obj import read_obj
from render.files.ply import read_ply
from render.mesh.mesh import Mesh
from render.mesh.surface import Surface


def load_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh.

    OBJ: its own `v` order is kept, vertices that no face uses and texture seams change nothing, polygons become fans.
    PLY: likewise. glTF: the scene's meshes one after the other, placed by their nodes. STL knows no shared vertices:
    corners at the same place become one vertex.

    Args:
        path: a file whose name ends in .obj, .ply, .glb, .gltf or .stl; metres, y up.

    Raises:
        InputError: no such file, another format, content that cannot be read, or a mesh that `Mesh` refuses.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a mesh must be one of {', '.join(SUFFIXES)}, found '{suffix}'")
    check_regular(path, "a mesh file")
    if suffix in _GLTF:
        return read_gltf(path)
    vertices, faces, surface = _READERS[suffix](path)
    return Mesh(vertices, faces, source=str(path), surface=surface)


def _read_stl(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    """Corners at the same place become one vertex: the format knows no shared ones."""
    import trimesh  # noqa: PLC0415  (half a second that most callers need not pay)

    try:
        loaded: Any = trimesh.load(io.BytesIO(path.read_bytes()), file_type="stl", process=False)
        vertices, faces = np.array(loaded.vertices, np.float64), np.array(loaded.faces)
    except Exception as error:  # its readers raise whatever they meet
        raise InputError(f"{path}: cannot be read as .stl ({said_by(error)})") from error
    vertices, merged = np.unique(vertices, axis=0, return_inverse=True)
    return vertices, merged.reshape(-1)[faces], None


_READERS = {".obj": read_obj, ".ply": read_ply, ".stl": _read_stl}
_GLTF = (".glb", ".gltf")
SUFFIXES = (".obj", ".ply", *_GLTF, ".stl")
