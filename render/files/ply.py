"""PLY: any elements and properties, ASCII and binary, polygons of any mix, texture coordinates at vertices or corners.

Read here, because trimesh refuses binary files whose faces are part triangles and part quads, and looks for textures.
Facts of the format: Greg Turk, "The PLY Polygon File Format" (1994); `texcoord` and `texnumber` are MeshLab's.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

import numpy as np

from render.errors import InputError
from render.files.obj_numbers import fans
from render.files.ply_elements import Element, Header, PlyError, header_of, read_elements
from render.files.textures import with_full_paths
from render.mesh.surface import Surface

_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texcoord_u", "texcoord_v"))
_INDICES = ("vertex_indices", "vertex_index")
_LARGEST_UV = 1e6  # repetitions of a texture


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    """Read a PLY file; polygons become fans, and what is neither vertex nor face is passed over.

    Returns:
        Vertices (N, 3) float64, faces (F, 3) int64, and the surface where the file has texture coordinates; its
        materials are the images that the file names (`comment TextureFile`). Indices out of range are not checked.

    Raises:
        InputError: no PLY file, or one that is shorter than its header says.
    """
    content = path.read_bytes()
    try:
        header = header_of(content)
        elements = read_elements(content, header)
        return _mesh(path, header, elements)
    except PlyError as error:
        raise InputError(f"{path}: cannot be read as .ply ({error})") from None


def _mesh(
    path: Path, header: Header, elements: dict[str, Element]
) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    vertex, face = elements.get("vertex"), elements.get("face")
    if vertex is None or not all(axis in vertex.columns for axis in "xyz"):
        raise PlyError("it has no vertices with x, y and z")
    vertices = np.stack([vertex.columns[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    if face is None and "tristrips" in elements:
        raise PlyError("its triangles are strips (tristrips), which are not read; save it with faces")
    indices = next((face.lists[name] for name in _INDICES if name in face.lists), None) if face else None
    if face is None or indices is None:
        return vertices, np.zeros((0, 3), np.int64), None
    counts, corners = indices
    if counts.min(initial=3) < 3:
        raise PlyError(f"face {int(np.argmax(counts < 3))} has fewer than three corners")
    places, polygon = fans(counts)
    faces = corners.astype(np.int64)[places]
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        return vertices, faces, None
    uvs, uv_of_corner = _coordinates(vertex, face, corners.astype(np.int64), counts)
    if uvs is None:
        return vertices, faces, None
    if not (np.abs(uvs) <= _LARGEST_UV).all():
        raise PlyError("texture coordinates that are no numbers, or far out of any image")
    materials, mtl = _images(header, path.parent)
    number = face.columns.get("texnumber", np.zeros(len(counts)))[polygon]
    known = (number >= 0) & (number < len(materials))
    used = np.where(known, number, len(materials)).astype(np.int64)
    surface = Surface(
        faces,
        np.arange(len(vertices)),
        uvs=uvs.astype(np.float32),
        uv_faces=uv_of_corner[places],
        face_materials=used if materials else None,
        materials=materials if known.all() or not materials else (*materials, "default"),
        mtl=mtl,
    )
    return vertices, faces, surface


def _coordinates(
    vertex: Element, face: Element, corners: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray]:
    """(U, 2) coordinates and (C,) the coordinate of each corner, -1 in faces without; None where there are none."""
    if "texcoord" in face.lists:
        lengths, values = face.lists["texcoord"]
        if not (np.isin(lengths, (0,)) | (lengths == 2 * counts)).all():
            raise PlyError("texcoord must hold two numbers a corner of its face")
        with_uv = np.repeat(lengths > 0, counts)
        if with_uv.any():
            return values.reshape(-1, 2), np.where(with_uv, np.cumsum(with_uv) - 1, -1)
    for names in _COORDINATES:
        if all(name in vertex.columns for name in names):
            return np.stack([vertex.columns[name] for name in names], axis=-1), corners
    return None, corners


def _images(header: Header, folder: Path) -> tuple[tuple[str, ...], str]:
    """Materials for the images that the header names, called after them, and their library with full paths."""
    names: dict[str, str] = {}
    for image in header.textures:
        stem = PureWindowsPath(image).stem or "material"
        names[stem if stem not in names else f"{stem}-{len(names)}"] = image
    mtl = "".join(f"newmtl {name}\nmap_Kd {image}\n" for name, image in names.items())
    return tuple(names), with_full_paths(mtl, folder)
