"""What a mesh file says beside its triangles: texture coordinates, materials, and its own numbering of vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from render.errors import InputError


@dataclass(frozen=True, eq=False)
class Surface:
    """The look of a template, and how to get back to the file that it came from.

    A mesh may be used with other vertices than its file had: seams are welded, for example. `faces` and `vertices`
    then still give the mesh of the file: moved vertices (..., N, 3) become `moved[..., vertices, :]`.

    Args:
        faces: (F, 3) int64 triangles in the file's numbering, in the file's order.
        vertices: (M,) int64, for each vertex of the file the vertex of the mesh in use.
        uvs: (U, 2) float32 texture coordinates, v upwards; None where the file has none.
        uv_faces: (F, 3) int64 indices into `uvs` for each corner of `faces`, -1 in faces without coordinates.
        face_materials: (F,) int64 indices into `materials`; None where the file names none.
        materials: names, in the order of their first use.
        mtl: the text of the material library (Wavefront MTL); "" where there is none.

    Raises:
        InputError: arrays that do not fit each other.
    """

    faces: np.ndarray
    vertices: np.ndarray
    uvs: np.ndarray | None = None
    uv_faces: np.ndarray | None = None
    face_materials: np.ndarray | None = None
    materials: tuple[str, ...] = ()
    mtl: str = ""

    def __post_init__(self) -> None:
        problems = []
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.vertices.ndim != 1:
            problems.append(
                f"faces {self.faces.shape} must be (F, 3) and vertices {self.vertices.shape} (M,)"
            )
        elif len(self.faces) and not (self.faces.min() >= 0 and self.faces.max() < len(self.vertices)):
            problems.append("faces use vertices that the file does not have")
        if (self.uvs is None) != (self.uv_faces is None):
            problems.append("uvs and uv_faces come together")
        elif self.uvs is not None and self.uv_faces is not None:
            seen = self.uv_faces is self.faces and len(self.uvs) >= len(self.vertices)
            if self.uvs.ndim != 2 or self.uvs.shape[1] != 2 or self.uv_faces.shape != self.faces.shape:
                problems.append(
                    f"uvs {self.uvs.shape} and uv_faces {self.uv_faces.shape} are of a wrong shape"
                )
            elif not seen and not (
                self.uv_faces.min(initial=0) >= -1 and self.uv_faces.max(initial=-1) < len(self.uvs)
            ):
                problems.append("uv_faces use texture coordinates that do not exist")
        used = self.face_materials
        if used is not None and (
            used.shape != (len(self.faces),)
            or not (0 <= used.min(initial=0) <= used.max(initial=0) < len(self.materials))
        ):
            problems.append("face_materials must hold one index of a material a face")
        if problems:
            raise InputError(f"texture and materials: {'; '.join(problems)}")

    @property
    def has_look(self) -> bool:
        """Whether there are texture coordinates or materials."""
        return self.uvs is not None or self.face_materials is not None

    def of_file(self, moved: np.ndarray) -> np.ndarray:
        """(..., N, 3) vertices of the mesh in use -> (..., M, 3) in the file's numbering."""
        return moved[..., self.vertices, :]


def plain_surface(faces: np.ndarray, n_vertices: int) -> Surface:
    """The surface of a mesh of which nothing else is known: its own faces (F, 3) and numbering."""
    return Surface(np.asarray(faces, np.int64), np.arange(n_vertices))
