"""Faces as a camera sees them: what both rasterisers and the visibility test start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from render.cameras import Camera
from render.errors import InputError
from render.mesh import Mesh

_LEAST_AREA = 1e-9  # pixels squared; a face seen edge-on covers no pixel and has no depth plane


@dataclass(frozen=True, eq=False)
class ScreenFaces:
    """Faces in front of a camera, in pixels.

    Args:
        ids: (K,) int64, index of each in the mesh's faces; edge-on faces and those behind the camera are left
            out.
        corners: (K, 3, 2) float64, pixels, y downwards.
        plane: (K, 3) float64, the reciprocal depth (1/m) over the image, which perspective makes affine:
            plane[0] + plane[1] (x - x0) + plane[2] (y - y0) with (x0, y0) the first corner.
    """

    ids: np.ndarray
    corners: np.ndarray
    plane: np.ndarray

    def reciprocal_depth(self, index: np.ndarray, points: np.ndarray) -> np.ndarray:
        """1 / depth of faces `index` (...,) (into `ids`) at image points (..., 2) in pixels."""
        offset = points - self.corners[index, 0]
        plane = self.plane[index]
        return plane[..., 0] + (plane[..., 1:] * offset).sum(axis=-1)


def screen_faces(mesh: Mesh, camera: Camera) -> ScreenFaces:
    """Project the faces of a mesh.

    Raises:
        InputError: a face reaches through the camera's near plane, so that it has no whole projection.
    """
    projected = camera.project(mesh.vertices)
    behind = projected[:, 2] < camera.near
    corners_behind = behind[mesh.faces].sum(axis=1)
    if ((corners_behind > 0) & (corners_behind < 3)).any():
        raise InputError(
            f"{mesh.source}: reaches through the near plane of camera '{camera.name}' ({camera.near:.3f} m "
            "in front of it); move the camera away, or use a smaller field of view"
        )
    ids = np.flatnonzero(corners_behind == 0)
    # Corners in the order of their indices: copies of a face, turned or not, then get the very same plane.
    triangles = projected[np.sort(mesh.faces[ids], axis=1)]
    edge_1, edge_2 = triangles[:, 1, :2] - triangles[:, 0, :2], triangles[:, 2, :2] - triangles[:, 0, :2]
    area = edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0]
    kept = np.abs(area) > _LEAST_AREA
    ids, triangles, edge_1, edge_2, area = ids[kept], triangles[kept], edge_1[kept], edge_2[kept], area[kept]
    value = 1 / triangles[:, :, 2]
    rise_1, rise_2 = value[:, 1] - value[:, 0], value[:, 2] - value[:, 0]
    slope_x = (rise_1 * edge_2[:, 1] - rise_2 * edge_1[:, 1]) / area
    slope_y = (rise_2 * edge_1[:, 0] - rise_1 * edge_2[:, 0]) / area
    return ScreenFaces(ids, triangles[:, :, :2], np.stack([value[:, 0], slope_x, slope_y], axis=1))


def expand(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts (K,): the owner k and the running number 0..counts[k]-1 of each of counts.sum() items."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
