"""Reading images at vertices: bilinear weights that never reach another surface or the background."""

from __future__ import annotations

import numpy as np

from render.cameras import Camera
from render.mesh import Mesh
from render.operator import SparseProduct
from render.raster import Raster
from render.screen import screen_faces
from render.visibility import visible_vertices

_REACH = 3  # pixels: how far a vertex may look for a pixel of its surface when none of its four neighbours shows it
_SLOPE_FACTOR, _SLACK, _MOST = 1.5, 1.0, 10.0  # see _own_surface; the last two in pixel footprints


def sampling(mesh: Mesh, cameras: tuple[Camera, ...], raster: Raster) -> tuple[SparseProduct, np.ndarray]:
    """How images of `raster` are read at the vertices' projections.

    A visible vertex is read from those of its four neighbouring pixels that show its own surface, with bilinear
    weights scaled to sum 1; if none does, from the nearest pixel within 3 that does. A vertex that is not visible
    gets whatever covers its projection in the same way, and 0 where nothing does.

    Args:
        mesh: N vertices, those that were rasterised.
        cameras: S views of H × W pixels.
        raster: of the mesh by the cameras.

    Returns:
        The product from (..., S * H * W, C) to (..., S * N, C), and (S, N) bool, which vertices are visible: in free
        line of sight (section 3.3 of the paper) and with at least one pixel to be read from.
    """
    pixels = raster.face_id[0].size
    visible = np.zeros((len(cameras), len(mesh.vertices)), bool)
    entries = []
    for view, camera in enumerate(cameras):
        rows, columns, values, found = _view_entries(
            mesh, camera, raster.face_id[view], raster.depth[view], visible_vertices(mesh, camera)
        )
        visible[view] = found
        entries.append((rows + view * len(mesh.vertices), columns + view * pixels, values))
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return SparseProduct(rows, columns, values, (visible.size, raster.face_id.size)), visible


def _view_entries(
    mesh: Mesh, camera: Camera, face_id: np.ndarray, depth: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Entries (rows: vertices, columns: pixels, values) for one view, and (N,) which vertices are visible."""
    height, width = camera.size
    projected = camera.project(mesh.vertices)
    vertices = np.flatnonzero(projected[:, 2] >= camera.near)
    place = projected[vertices, :2] - 0.5  # in units where pixel centres are whole numbers
    base = np.floor(np.clip(place, -_REACH - 2, (width + _REACH + 2, height + _REACH + 2))).astype(np.int64)
    steps = np.stack(np.meshgrid(*[np.arange(-_REACH, _REACH + 2)] * 2, indexing="ij"), -1).reshape(-1, 2)
    pixel = base[:, None] + steps  # (V, K, 2), x and y
    inside = ((pixel >= 0) & (pixel < (width, height))).all(-1)
    index = np.where(inside, pixel[..., 1] * width + pixel[..., 0], 0)
    usable = inside & (face_id.reshape(-1)[index] >= 0)
    offset = pixel - place[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    own = _own_surface(mesh, camera, face_id.reshape(-1)[index], depth.reshape(-1)[index], vertices, distance)
    usable &= own | ~seen[vertices, None]

    bilinear = np.clip(1 - np.abs(offset), 0, None).prod(-1) * usable
    total = bilinear.sum(axis=1, keepdims=True)
    near = np.where(usable & (distance <= _REACH), distance, np.inf)
    nearest = np.zeros_like(bilinear)
    nearest[np.arange(len(vertices)), near.argmin(axis=1)] = np.isfinite(near.min(axis=1))
    # Weights of a thousandth would blow up rounding and are no better than the nearest pixel.
    weights = np.where(
        total > 1e-3, np.divide(bilinear, total, out=nearest.copy(), where=total > 1e-3), nearest
    )
    row, column = np.nonzero(weights)
    found = np.zeros(len(mesh.vertices), bool)
    found[vertices[row]] = True
    return vertices[row], index[row, column], weights[row, column], found & seen


def _own_surface(
    mesh: Mesh,
    camera: Camera,
    face_id: np.ndarray,
    depth: np.ndarray,
    vertices: np.ndarray,
    distance: np.ndarray,
) -> np.ndarray:
    """(V, K) bool: whether pixels (V, K) show the surface that the vertices (V,) lie on.

    They do where their depth differs from the vertex's by no more than the steeper of both surfaces rises over their
    distance in the image (half as much again, as surfaces bend, and one pixel's footprint), and by no more than ten
    pixels' footprints, so that faces seen nearly edge-on do not reach for what is far behind.
    """
    faces = screen_faces(mesh, camera)
    slope = np.zeros(len(mesh.faces))  # metres of depth per pixel
    corner_depth = camera.project(mesh.vertices)[:, 2]
    nearest = corner_depth[mesh.faces[faces.ids]].min(axis=1)
    slope[faces.ids] = np.hypot(faces.plane[:, 1], faces.plane[:, 2]) * nearest**2  # d(z) = z² d(1/z)
    steepest = np.zeros(len(mesh.vertices))
    np.maximum.at(steepest, mesh.faces.reshape(-1), np.repeat(slope, 3))
    footprint = corner_depth[vertices, None] / (
        camera.projection[1, 1] * camera.size[0] / 2
    )  # metres per pixel
    rise = np.maximum(steepest[vertices, None], slope[face_id]) * distance
    allowed = np.minimum(_SLOPE_FACTOR * rise + _SLACK * footprint, _MOST * footprint)
    return np.abs(depth - corner_depth[vertices, None]) <= allowed
