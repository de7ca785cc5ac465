"""A mesh laid out flat in charts, which is projected in place of it: images in texture space (the paper's table 7)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from render.cameras import Camera
from render.errors import InputError
from render.extras import optional
from render.framing import frame_cameras
from render.maps.sampling import reading_weights
from render.mesh.mesh import Mesh
from render.mesh.sparse import SparseProduct
from render.raster.raster import Raster
from render.views import UV


def atlas(vertices: np.ndarray, faces: np.ndarray, purpose: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Charts by xatlas.

    Args:
        vertices: (N, 3) metres. faces: (F, 3).
        purpose: what needs xatlas, as a message about its lack names it.

    Returns:
        Places (U, 2) float64 in the unit square, faces (F, 3) int64 of them in the order given, and (U,) int64 which of
        the N vertices each place is of; those at a seam have several.

    Raises:
        InputError: xatlas is not installed.
    """
    xatlas = optional("xatlas", UV, purpose)
    origin, laid, uvs = xatlas.parametrize(
        np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32)
    )
    return uvs.astype(np.float64), laid.astype(np.int64), origin.astype(np.int64)


def flat_layout(mesh: Mesh) -> Mesh:
    """A mesh's charts by xatlas, in the plane z = 0 and as large together as its surface: (U, 3), faces in its order.

    Raises:
        InputError: xatlas is not installed, or has left out faces.
    """
    uvs, faces, origin = atlas(mesh.vertices, mesh.faces, f"maps.views: {UV}")
    if faces.shape != mesh.faces.shape or not np.array_equal(origin[faces], mesh.faces):
        raise InputError(
            f"{mesh.source}: xatlas finds no layout for its {len(mesh.faces)} faces; use other views"
        )
    flat = np.pad(uvs, ((0, 0), (0, 1)))
    scale = np.sqrt(_area(mesh.vertices[mesh.faces]) / max(_area(flat[faces]), 1e-30))
    return Mesh(flat * scale, faces, mesh.source)


def check_layout(layout: Mesh, mesh: Mesh) -> None:
    """Raise InputError unless the faces are those of `mesh`: each vertex of the layout is of one of the mesh's."""
    fits = layout.faces.shape == mesh.faces.shape
    if fits:
        origin = origins(layout, mesh)
        fits = bool((origin >= 0).all()) and np.array_equal(origin[layout.faces], mesh.faces)
    if not fits:
        raise InputError(
            f"{mesh.source}: its layout has {len(layout.vertices)} vertices and {len(layout.faces)} faces that are not "
            f"those of the mesh ({len(mesh.vertices)} and {len(mesh.faces)})"
        )


def origins(layout: Mesh, mesh: Mesh) -> np.ndarray:
    """(U,) int64 which vertex of the mesh each of the layout's is, -1 where no face has it."""
    origin = np.full(len(layout.vertices), -1)
    origin[layout.faces] = mesh.faces
    return origin


def layout_camera(layout: Mesh, size: tuple[int, int]) -> Camera:
    """The camera that looks straight at a layout, so that its image is the layout itself, upright."""
    return replace(frame_cameras(layout, views="front", size=size)[0], name=UV)


def layout_sampling(
    mesh: Mesh, layout: Mesh, cameras: tuple[Camera, ...], raster: Raster
) -> tuple[SparseProduct, np.ndarray]:
    """`render.maps.sampling.sampling` for images of a layout: a vertex is read as the mean of its places.

    A place is read from pixels of its own chart only, as charts that lie side by side need not be neighbours.

    Returns:
        The product from (..., S * H * W, C) to (..., S * N, C), and (S, N) bool, vertices that can be read.
    """
    rows, columns, values, visible = reading_weights(layout, cameras, raster, _charts(layout))
    origin, n = origins(layout, mesh), len(mesh.vertices)
    read = np.zeros((len(cameras), n), np.int64)  # places that are read, of each vertex
    for seen, count in zip(visible, read, strict=True):
        np.add.at(count, origin[seen], 1)
    view, place = np.divmod(rows, len(origin))
    vertex = origin[place]
    kept = visible[view, place]
    number = read[view, vertex].clip(min=1)
    product = SparseProduct(
        (view * n + vertex)[kept],
        columns[kept],
        (values / number)[kept],
        (read.size, raster.face_id.size),
    )
    return product, read > 0


def one_place(layout: Mesh, mesh: Mesh) -> np.ndarray:
    """(N, 3) one of the places of each vertex, the first; the layout's middle for a vertex of no face."""
    places = np.tile(layout.vertices.mean(axis=0), (len(mesh.vertices), 1))
    origin = origins(layout, mesh)
    owned = np.flatnonzero(origin >= 0)[::-1]  # so that the first place of a vertex is written last
    places[origin[owned]] = layout.vertices[owned]
    return places


def _charts(layout: Mesh) -> np.ndarray:
    """(U,) the number of the chart that each vertex is in."""
    edges, n = layout.edges, len(layout.vertices)
    graph = coo_array((np.ones(len(edges), bool), tuple(edges.T)), shape=(n, n))
    labels: np.ndarray = connected_components(graph, directed=False)[1]
    return labels


def _area(corners: np.ndarray) -> float:
    """Of triangles (F, 3, 3), all together."""
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)
