"""Reading images at vertices: sparse weights that never reach another surface or the background."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from render.cameras import Camera
from render.mesh.mesh import Mesh
from render.mesh.sparse import SparseProduct
from render.raster.raster import Raster
from render.raster.screen import screen_faces
from render.raster.visibility import visible_vertices

_REACH = 3.0  # pixels: how far a vertex looks for a pixel of its surface when its four neighbours show none
_FIT_REACH = 2.5  # pixels: how far the pixels lie that take part in the affine correction
_FIT_DAMPING = 1.0  # pixel footprints squared: keeps the correction from amplifying the images' noise
# A pixel shows the vertex's surface if the depth between them is no more than the surfaces' slopes explain
# (half as much again, as surfaces bend, and one pixel's footprint), and no more than ten footprints: faces
# seen nearly edge-on must not reach for what is far behind.
_SLOPE_FACTOR, _SLACK, _MOST = 1.5, 1.0, 10.0


@dataclass(frozen=True, eq=False)
class _Window:
    """The K pixels around each of V vertices in one view: (V, K) arrays.

    index: into the view's flattened pixels; usable: in the image and covered; offset (V, K, 2): pixels, from
    the vertex's projection to the pixel's centre; position (V, K, 3): metres, the surface point the pixel
    shows, relative to the vertex; footprint (V, 1): metres a pixel spans at the vertex's depth.
    """

    index: NDArray[np.int64]
    usable: NDArray[np.bool_]
    offset: NDArray[np.float64]
    position: NDArray[np.float64]
    footprint: NDArray[np.float64]

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        return np.hypot(self.offset[..., 0], self.offset[..., 1])

    def of(self, vertices: NDArray[np.bool_]) -> _Window:
        """Those of some of the vertices (V,)."""
        return _Window(*(getattr(self, field.name)[vertices] for field in fields(self)))


def sampling(mesh: Mesh, cameras: tuple[Camera, ...], raster: Raster) -> tuple[SparseProduct, np.ndarray]:
    """How images of `raster` are read at the vertices' projections.

    A visible vertex is read from those of its four neighbouring pixels that show its own surface, with
    bilinear weights scaled to sum 1; if none does, from the nearest pixel within 3 that does. At silhouettes
    that alone would be off by a pixel times the surface's slope, so the weights are then corrected, with the
    pixels of its surface within 2.5, to give the vertex its own place on the template's position map (and
    hence on that of every affinely deformed template). A vertex that is not visible gets the plain weights
    over whatever covers its projection, and none where nothing does.

    Args:
        mesh: N vertices, those that were rasterised.
        cameras: S views of H × W pixels.
        raster: of the mesh by the cameras.

    Returns:
        The product from (..., S * H * W, C) to (..., S * N, C), and (S, N) bool, which vertices are visible:
        in free line of sight (section 3.3 of the paper) and with at least one pixel to be read from.
    """
    rows, columns, values, visible = reading_weights(mesh, cameras, raster)
    return SparseProduct(rows, columns, values, (visible.size, raster.face_id.size)), visible


def reading_weights(
    mesh: Mesh, cameras: tuple[Camera, ...], raster: Raster, parts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The entries of `sampling`'s matrix.

    Args:
        mesh, cameras, raster: as of `sampling`.
        parts: (N,) the part of the mesh that each vertex is in, where a visible one is to be read from pixels of its
            part alone; None: from any that show its surface.

    Returns:
        Rows (K,), columns (K,) and values (K,), and (S, N) bool, which vertices are visible.
    """
    pixels, n_vertices = raster.face_id[0].size, len(mesh.vertices)
    visible = np.zeros((len(cameras), n_vertices), bool)
    entries = []
    for view, camera in enumerate(cameras):
        vertices, window, own = _look_around(mesh, camera, raster, view)
        if parts is not None:
            of_face = parts[mesh.faces[:, 0]]
            own &= of_face[raster.face_id[view].reshape(-1)[window.index]] == parts[vertices, None]
        seen = visible_vertices(mesh, camera)[vertices]
        seen &= (own & (window.distance <= _REACH)).any(axis=1)
        visible[view, vertices[seen]] = True
        usable = np.where(seen[:, None], own, window.usable)
        weights = _plain_weights(window, usable)
        weights[seen] += _affine_correction(window.of(seen), usable[seen], weights[seen])
        row, column = np.nonzero(weights)
        place = view * n_vertices + vertices[row], view * pixels + window.index[row, column]
        entries.append((*place, weights[row, column]))
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return rows, columns, values, visible


def _look_around(
    mesh: Mesh, camera: Camera, raster: Raster, view: int
) -> tuple[np.ndarray, _Window, np.ndarray]:
    """Vertices (V,) before the camera, the pixels around them, and (V, K) which of them show its surface."""
    height, width = camera.size
    projected = camera.project(mesh.vertices)
    vertices = np.flatnonzero(projected[:, 2] >= camera.near)
    projected = projected[vertices]
    place = projected[:, :2] - 0.5  # in units where pixel centres are whole numbers
    base = np.floor(np.clip(place, -_REACH - 2, (width + _REACH + 2, height + _REACH + 2)))
    steps = np.arange(-int(_REACH), int(_REACH) + 2)
    pixel = base[:, None] + np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    inside = ((pixel >= 0) & (pixel < (width, height))).all(-1)
    index = np.where(inside, pixel[..., 1] * width + pixel[..., 0], 0).astype(np.int64)

    face = raster.face_id[view].reshape(-1)[index]
    surface = (
        (mesh.vertices[mesh.faces[raster.face_id[view]]] * raster.barycentric[view][..., None])
        .sum(-2)
        .reshape(-1, 3)
    )
    window = _Window(
        index=index,
        usable=inside & (face >= 0),
        offset=pixel - place[:, None],
        position=surface[index] - mesh.vertices[vertices, None],
        footprint=projected[:, 2:] / (camera.projection[1, 1] * height / 2),
    )
    face_slope, vertex_slope = _slopes(mesh, camera)
    rise = np.maximum(vertex_slope[vertices, None], face_slope[face]) * window.distance
    allowed = np.minimum(_SLOPE_FACTOR * rise + _SLACK * window.footprint, _MOST * window.footprint)
    apart = np.abs(window.position @ camera.view[2, :3])
    return vertices, window, window.usable & (apart <= allowed)


def _slopes(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Metres of depth per pixel on each face (F,), 0 where edge-on, and the steepest at each vertex (N,)."""
    faces = screen_faces(mesh, camera)
    of_face = np.zeros(len(mesh.faces))
    of_face[faces.ids] = np.hypot(faces.plane[:, 1], faces.plane[:, 2]) * faces.nearest**2  # dz = z² d(1/z)
    of_vertex = np.zeros(len(mesh.vertices))
    np.maximum.at(of_vertex, mesh.faces.reshape(-1), np.repeat(of_face, 3))
    return of_face, of_vertex


def _plain_weights(window: _Window, usable: np.ndarray) -> NDArray[np.float64]:
    """(V, K): bilinear over usable pixels with sum 1, else the nearest usable one within reach, else 0."""
    bilinear = np.clip(1 - np.abs(window.offset), 0, None).prod(-1) * usable
    total = bilinear.sum(axis=1, keepdims=True)
    near = np.where(usable & (window.distance <= _REACH), window.distance, np.inf)
    weights: NDArray[np.float64] = np.zeros_like(bilinear)
    weights[np.arange(len(near)), near.argmin(axis=1)] = np.isfinite(near.min(axis=1))
    # Below a thousandth the four neighbours tell no more than the nearest pixel, and rounding would be blown up.
    np.divide(bilinear, total, out=weights, where=total > 1e-3)
    return weights


def _affine_correction(window: _Window, usable: np.ndarray, weights: np.ndarray) -> NDArray[np.float64]:
    """(V, K) change of the weights, of sum 0, that brings Σ weight · position to 0: damped least squares."""
    support = (usable & (window.distance <= _FIT_REACH))[..., None]
    position = window.position / window.footprint[..., None]
    mean = (position * support).sum(axis=1, keepdims=True) / np.maximum(support.sum(axis=1, keepdims=True), 1)
    spread = (position - mean) * support
    missing = -(weights[..., None] * position).sum(axis=1)
    gram = np.einsum("vki,vkj->vij", spread, spread) + _FIT_DAMPING * np.eye(3)
    change: NDArray[np.float64] = np.einsum(
        "vki,vi->vk", spread, np.linalg.solve(gram, missing[..., None])[..., 0]
    )
    return change
