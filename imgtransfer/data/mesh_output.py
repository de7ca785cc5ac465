"""Moved garments as one mesh file a frame, with the texture coordinates, materials and numbering of their template."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from imgtransfer.data.texture_files import bring_textures, store_textures, writer_into
from render import InputError, Mesh
from render.errors import one_line
from render.files.atomic import written_whole, written_whole_folder
from render.files.mtl import textures
from render.mesh.mesh import check_finite
from render.mesh.surface import Surface, plain_surface

_log = logging.getLogger(__name__)

MeshKind = Literal["obj", "ply"]
LIBRARY = "materials.mtl"


class MeshFrames:
    """Writes a moving mesh into a folder as one file a frame, `<name>_0000.obj` and so on, some frames at a time.

    Textures that can be found are copied beside the files, and named by their bare names; the others are named in
    the log.

    Args:
        folder: is there already, and keeps what it holds.
        template: N vertices; with a surface, the files have the vertices, triangles, texture coordinates and
            materials of the file that the template came from, in that file's order.
        kind: "obj" (texture coordinates by `vt`, materials by a library beside the files) or "ply" (coordinates by
            `s` and `t` a vertex, or by `texcoord` a face where a vertex has several; PLY knows no materials).
        name: what the file names begin with.
        step: what the numbers in the file names count by.
    """

    def __init__(
        self, folder: Path, template: Mesh, kind: MeshKind, *, name: str = "frame", step: int = 1
    ) -> None:
        self._folder, self._template, self._kind, self._name = folder, template, kind, name
        self._step, self._next = step, 0
        surface = template.surface or plain_surface(template.faces, len(template.vertices))
        if surface.mtl:
            mtl, missing = bring_textures(surface.mtl, folder)
            surface = replace(surface, mtl=mtl)
            if missing:
                _log.warning(
                    "note: textures of %s that are no images here: %s; put them beside the written files",
                    one_line(template.source),
                    one_line(", ".join(missing)),
                )
        self._surface = surface
        self._writer = _Obj(surface) if kind == "obj" else _Ply(surface)
        if kind == "obj" and surface.mtl:
            (folder / LIBRARY).write_text(surface.mtl)

    def add(self, vertices: np.ndarray) -> None:
        """Write the next frames: (T, N, 3) metres, in the template's vertex order.

        Raises:
            InputError: another number of vertices than the template has, or one that is not finite; names its frame.
        """
        if vertices.ndim != 3 or vertices.shape[1:] != self._template.vertices.shape:
            wanted = f"(frames, {len(self._template.vertices)}, 3)"
            raise InputError(
                f"{self._template.source}: moved vertices must have shape {wanted}, found {vertices.shape}"
            )
        check_finite(vertices, f"{self._template.source}: moved vertices", first=self._next // self._step)
        for frame in self._surface.of_file(vertices):
            self._write(f"{self._name}_{self._next:04d}", frame)
            self._next += self._step

    def add_still(self, name: str) -> None:
        """Write the template itself, under another name."""
        self._write(name, self._surface.of_file(self._template.vertices[None])[0])

    def _write(self, name: str, vertices: np.ndarray) -> None:
        (self._folder / f"{name}.{self._kind}").write_bytes(self._writer.to_bytes(vertices))


@contextmanager
def written_mesh_frames(
    folder: Path, template: Mesh, kind: MeshKind, *, name: str = "frame"
) -> Iterator[MeshFrames]:
    """Yield what takes the frames of a folder of meshes, which appears as a whole, in place of an earlier one.

    Arguments as for `MeshFrames`.
    """
    with written_whole_folder(folder) as temporary:
        yield MeshFrames(temporary, template, kind, name=name)


def save_mesh_frames(
    folder: Path, vertices: np.ndarray, template: Mesh, kind: MeshKind, *, name: str = "frame"
) -> None:
    """Write frames (T, N, 3) that are in memory; see `written_mesh_frames`.

    Raises:
        InputError: another number of vertices than the template has, or one that is not finite; names its frame.
    """
    with written_mesh_frames(folder, template, kind, name=name) as frames:
        frames.add(vertices)


def save_obj(path: Path, mesh: Mesh) -> None:
    """Write one mesh as OBJ, with its material library beside it (`<name>.mtl`) and its textures in textures/.

    Vertices, triangles, texture coordinates and materials are those of the file that the mesh came from, in its order.
    """
    surface, library = mesh.surface or plain_surface(mesh.faces, len(mesh.vertices)), path.with_suffix(".mtl")
    if surface.mtl:
        mtl = store_textures(surface.mtl, writer_into(path.parent))
        with written_whole(library) as temporary:
            temporary.write_text(mtl)
    with written_whole(path) as temporary:
        temporary.write_bytes(_Obj(surface, library.name).to_bytes(surface.of_file(mesh.vertices)))


class _Obj:
    """Writes a moving mesh as OBJ; all but the `v` lines is made once."""

    def __init__(self, surface: Surface, library: str = LIBRARY) -> None:
        self.head = f"mtllib {library}\n" if surface.mtl else ""
        uvs = surface.uvs.tolist() if surface.uvs is not None else []
        lines = [f"vt {u:.8g} {v:.8g}\n" for u, v in uvs]
        corners = [[str(i) for i in face] for face in (surface.faces + 1).tolist()]
        if surface.uv_faces is not None:
            for face, pairs in zip(corners, (surface.uv_faces + 1).tolist(), strict=True):
                face[:] = [f"{i}/{uv}" if uv else i for i, uv in zip(face, pairs, strict=True)]
        used, current = surface.face_materials, -1
        for number, face in enumerate(corners):
            if used is not None and used[number] != current:
                current = int(used[number])
                lines.append(f"usemtl {surface.materials[current]}\n")
            lines.append(f"f {' '.join(face)}\n")
        self.tail = "".join(lines)

    def to_bytes(self, vertices: np.ndarray) -> bytes:
        """One frame, vertices (M, 3)."""
        moved = "".join(f"v {x:.8g} {y:.8g} {z:.8g}\n" for x, y, z in vertices.tolist())
        return (self.head + moved + self.tail).encode()


class _Ply:
    """Writes a moving mesh as binary PLY; the faces are made once."""

    def __init__(self, surface: Surface) -> None:
        uvs, uv_faces = surface.uvs, surface.uv_faces
        self.vertex_uvs = _one_uv_a_vertex(surface)
        by_face = uvs is not None and uv_faces is not None and self.vertex_uvs is None
        fields: list[tuple] = [("n", "u1"), ("indices", "<i4", 3)]
        fields += [("m", "u1"), ("texcoord", "<f4", 6)] if by_face else []
        faces = np.zeros(len(surface.faces), fields)
        faces["n"], faces["indices"] = 3, surface.faces
        if by_face and uvs is not None and uv_faces is not None:
            corners = np.where((uv_faces >= 0)[..., None], uvs[np.maximum(uv_faces, 0)], 0)
            faces["m"], faces["texcoord"] = 6, corners.reshape(-1, 6)
        head = ["ply", "format binary_little_endian 1.0"]
        head += [f"comment TextureFile {name}" for name in textures(surface.mtl)]
        head += [f"element vertex {len(surface.vertices)}", *(f"property float {axis}" for axis in "xyz")]
        head += ["property float s", "property float t"] if self.vertex_uvs is not None else []
        head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        head += ["property list uchar float texcoord"] if by_face else []
        self.head = "\n".join([*head, "end_header", ""]).encode()
        self.faces = faces.tobytes()

    def to_bytes(self, vertices: np.ndarray) -> bytes:
        """One frame, vertices (M, 3)."""
        columns = vertices if self.vertex_uvs is None else np.concatenate([vertices, self.vertex_uvs], axis=1)
        return self.head + np.ascontiguousarray(columns, "<f4").tobytes() + self.faces


def _one_uv_a_vertex(surface: Surface) -> np.ndarray | None:
    """(M, 2) where no vertex has two texture coordinates, else None."""
    if surface.uvs is None or surface.uv_faces is None:
        return None
    with_uv = surface.uv_faces.reshape(-1) >= 0
    corner, uv = surface.faces.reshape(-1)[with_uv], surface.uv_faces.reshape(-1)[with_uv]
    uvs = np.zeros((len(surface.vertices), 2), np.float32)
    uvs[corner] = surface.uvs[uv]
    return uvs if np.array_equal(uvs[corner], surface.uvs[uv]) else None
