"""Seams that a modelling program split are joined, and the way back to its vertices is kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from render import InputError, Mesh, Option
from render.mesh.surface import Surface, plain_surface

TOLERANCE = 1e-5  # metres; what lies closer is the same point


@dataclass(frozen=True, eq=False)
class Welded:
    """A mesh whose seams are joined.

    Args:
        mesh: in the order of the first of each group of joined vertices; `mesh.surface` has the file's own numbering,
            triangles and texture coordinates.
        chosen: (N,) int64, the vertex of the given mesh that stands for each vertex.
        joined: how many vertices went away.
    """

    mesh: Mesh
    chosen: np.ndarray
    joined: int


def seam_groups(mesh: Mesh, tolerance: float = TOLERANCE) -> np.ndarray:
    """(N,) int64, for each vertex the first of those that lie within `tolerance` of each other.

    Only vertices at open edges are joined: where two layers of cloth touch inside, they stay two.
    """
    halves = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(halves, axis=0, return_counts=True)
    border = np.unique(edges[uses == 1])
    first = np.arange(len(mesh.vertices))
    pairs = cKDTree(mesh.vertices[border]).query_pairs(tolerance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(border),) * 2)
    _, group = connected_components(links, directed=False)
    smallest = np.full(group.max(initial=-1) + 1, len(first))
    np.minimum.at(smallest, group, border)
    first[border] = smallest[group]
    return first


def weld(mesh: Mesh, tolerance: float = TOLERANCE) -> Welded:
    """Join the seams of a mesh; triangles that lose their area are dropped.

    Args:
        mesh: as its file has it, metres.
        tolerance: metres.
    """
    first = seam_groups(mesh, tolerance)
    chosen = np.unique(first)
    number = np.empty(len(first), np.int64)
    number[chosen] = np.arange(len(chosen))
    of_vertex = number[first]
    faces = of_vertex[mesh.faces]
    a, b, c = faces.T
    base = mesh.surface or plain_surface(mesh.faces, len(mesh.vertices))
    surface = Surface(
        base.faces,
        of_vertex[base.vertices],
        uvs=base.uvs,
        uv_faces=base.uv_faces,
        face_materials=base.face_materials,
        materials=base.materials,
        mtl=base.mtl,
    )
    kept = faces[(a != b) & (b != c) & (c != a)]
    welded = Mesh(mesh.vertices[chosen], kept, source=mesh.source, surface=surface)
    return Welded(welded, chosen, len(first) - len(chosen))


def weld_motion(
    vertices: np.ndarray, welded: Welded, *, source: str, part: float = 1e-3, first: int = 0
) -> np.ndarray:
    """(T, M, 3) vertices in the file's order -> (T, N, 3) in the welded mesh's.

    Args:
        vertices: metres. source: what messages call them.
        part: metres, how far joined vertices may part in motion. first: number of the first of the T frames.

    Raises:
        InputError: joined vertices part, so that they are no seam.
    """
    assert welded.mesh.surface is not None
    moved = vertices[:, welded.chosen]
    gap = np.linalg.norm(moved[:, welded.mesh.surface.vertices] - vertices, axis=-1)
    frame, vertex = np.unravel_index(int(gap.argmax()), gap.shape)
    if gap[frame, vertex] > part:
        other = welded.chosen[welded.mesh.surface.vertices[vertex]]
        raise InputError(
            f"{source}: vertices {other} and {vertex} lie on each other in the rest pose but part by "
            f"{1000 * gap[frame, vertex]:.0f} mm in frame {first + frame}; this is no seam: leave out {Option('weld')}"
        )
    return moved
