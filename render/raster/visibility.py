"""Which vertices a view sees, and from which of its pixels their values are read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.cameras import Camera
from render.mesh.mesh import Mesh
from render.raster.reference import covers
from render.raster.screen import expand, screen_faces

# How much nearer (metres) an occluding face must be: rounding of the projection, well below any cloth thickness.
_CLEARANCE = 1e-6


def visible_vertices(mesh: Mesh, camera: Camera) -> NDArray[np.bool_]:
    """Vertices that lie on the camera's layer, decided against the mesh itself, not its pixels.

    A vertex is hidden by every face that it is no corner of, that covers its projection and that is nearer; it
    lies on layer k where k faces hide it. Both sides of cloth hide and are seen. A vertex behind an edge is
    hidden by one of the two faces beside the edge.

    Args:
        mesh: N vertices.
        camera: the view and its layer.

    Returns:
        (N,) bool; false outside the image.
    """
    height, width = camera.size
    projected = camera.project(mesh.vertices)
    with np.errstate(invalid="ignore"):
        seen = (
            (projected[:, 2] >= camera.near)
            & (projected[:, :2] >= 0).all(axis=1)
            & (projected[:, :2] < (width, height)).all(axis=1)
        )
    faces = screen_faces(mesh, camera)
    # Bins of one pixel: vertices sorted by bin, and each face looks into the bins of its bounding box.
    candidates = np.flatnonzero(seen)
    cell = projected[candidates, :2].astype(np.int64)
    order = np.argsort(cell[:, 1] * width + cell[:, 0], kind="stable")
    candidates = candidates[order]
    bins = (cell[:, 1] * width + cell[:, 0])[order]
    first = np.clip(np.floor(faces.corners.min(axis=1)), 0, (width, height)).astype(np.int64)
    last = np.clip(np.floor(faces.corners.max(axis=1)), -1, (width - 1, height - 1)).astype(np.int64)
    extent = np.maximum(last - first + 1, 0)
    face, row = expand(np.where(extent[:, 0] > 0, extent[:, 1], 0))  # one run of bins per image row of a face
    start = (first[face, 1] + row) * width
    low = np.searchsorted(bins, start + first[face, 0], side="left")
    high = np.searchsorted(bins, start + last[face, 0], side="right")
    run, number = expand(high - low)
    face, vertex = face[run], candidates[low[run] + number]
    apart = (mesh.faces[faces.ids[face]] != vertex[:, None]).all(axis=1)
    face, vertex = face[apart], vertex[apart]
    point = projected[vertex, :2]
    face_depth = 1 / np.maximum(faces.reciprocal_depth(face, point), 1e-12)
    hides = covers(faces.corners[face], point) & (face_depth < projected[vertex, 2] - _CLEARANCE)
    layer: NDArray[np.bool_] = seen & (np.bincount(vertex[hides], minlength=len(seen)) == camera.layer)
    return layer
