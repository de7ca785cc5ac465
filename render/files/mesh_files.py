"""Meshes from files, with the vertices in the file's order."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError, said_by
from render.files.atomic import check_regular
from render.files.glb import check_glb
from render.files.obj import read_obj
from render.mesh.mesh import Mesh
from render.mesh.surface import Surface

SUFFIXES = (".obj", ".ply", ".glb", ".stl")


def load_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh.

    OBJ: its own `v` order is kept, vertices that no face uses and texture seams change nothing, polygons become fans.
    PLY: likewise. GLB: the scene's meshes one after the other, placed by their nodes. STL knows no shared vertices:
    corners at the same place become one vertex.

    Args:
        path: a file whose name ends in .obj, .ply, .glb or .stl; metres, y up.

    Raises:
        InputError: no such file, another format, content that cannot be read, or a mesh that `Mesh` refuses.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a mesh must be one of {', '.join(SUFFIXES)}, found '{suffix}'")
    check_regular(path, "a mesh file")
    vertices, faces, surface = read_obj(path) if suffix == ".obj" else _read_other(path)
    if suffix == ".stl":
        vertices, merged = np.unique(vertices, axis=0, return_inverse=True)
        faces, surface = merged.reshape(-1)[faces], None
    return Mesh(vertices, faces, source=str(path), surface=surface)


def _read_other(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    import trimesh  # noqa: PLC0415  (half a second that most callers need not pay)

    # Without this trimesh splits a PLY's vertices at texture seams.
    suffix = path.suffix.lower()
    options: dict[str, Any] = {"fix_texture": False, "skip_materials": True} if suffix == ".ply" else {}
    content = path.read_bytes()
    if suffix == ".glb":
        check_glb(path, content)
    try:
        # From memory, so that it cannot follow the file's references to others.
        loaded: Any = trimesh.load(io.BytesIO(content), file_type=suffix[1:], process=False, **options)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
        vertices = np.array(loaded.vertices, np.float64)
        faces = np.array(getattr(loaded, "faces", np.zeros((0, 3), np.int64)))
        return vertices, faces, _texture(loaded, vertices, faces)
    except Exception as error:  # its readers raise whatever they meet
        raise InputError(f"{path}: cannot be read as {suffix} ({said_by(error)})") from error


def _texture(loaded: Any, vertices: np.ndarray, faces: np.ndarray) -> Surface | None:
    """The texture coordinates of a PLY (a pair a vertex, or three pairs a face) or a GLB (a pair a vertex)."""
    raw = loaded.metadata.get("_ply_raw") if hasattr(loaded, "metadata") else None
    uvs = _ply_coordinates(raw, len(faces)) if raw else getattr(loaded.visual, "uv", None)
    if uvs is None or not len(faces):
        return None
    corners = faces if len(uvs) == len(vertices) else np.arange(3 * len(faces)).reshape(-1, 3)
    return Surface(
        faces.astype(np.int64),
        np.arange(len(vertices)),
        uvs=np.asarray(uvs, np.float32),
        uv_faces=corners.astype(np.int64),
    )


def _ply_coordinates(raw: dict[str, Any], n_faces: int) -> np.ndarray | None:
    """(N, 2) where vertices have coordinates, (3 F, 2) where the triangles' corners do, else None."""
    vertex, face = raw["vertex"]["data"], raw.get("face", {}).get("data")
    for names in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        if all(name in (vertex if isinstance(vertex, dict) else vertex.dtype.names) for name in names):
            return np.stack([np.asarray(vertex[name]).reshape(-1) for name in names], axis=-1)
    if face is None or "texcoord" not in (face if isinstance(face, dict) else face.dtype.names or ()):
        return None
    corners = np.asarray(face["texcoord"] if isinstance(face, dict) else face["texcoord"]["f1"])
    return corners.reshape(-1, 2) if corners.size == 6 * n_faces else None
