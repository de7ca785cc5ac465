"""Cut an even triangle mesh along the zero line of a scalar field without making slivers."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from render.mesh.mesh import Mesh


def cut_at_zero(mesh: Mesh, values: np.ndarray) -> Mesh:
    """The part of `mesh` where the field is negative; its border lies on the zero line.

    Of every edge that crosses the line the nearer end is moved onto the crossing, so that triangles stay even and
    none is split.

    Args:
        mesh: an even mesh.
        values: (N,) field at its vertices.
    """
    vertices, values = mesh.vertices.copy(), values.astype(np.float64).copy()
    start, end = mesh.edges[values[mesh.edges[:, 0]] * values[mesh.edges[:, 1]] < 0].T
    fraction = values[start] / (values[start] - values[end])
    crossing = mesh.vertices[start] + fraction[:, None] * (mesh.vertices[end] - mesh.vertices[start])
    mover = np.where(fraction < 0.5, start, end)
    distance = np.minimum(fraction, 1 - fraction)
    # Where edges of one vertex disagree, the shortest move is written last.
    for edge in np.argsort(-distance):
        vertices[mover[edge]] = crossing[edge]
    values[mover] = 0.0
    corners = values[mesh.faces]
    # A face whose corners were all moved onto the line lies on the side where its centre was.
    flat = (corners == 0).all(axis=1)
    keep = (corners <= 0).all(axis=1) & ~flat
    return without_unused(Mesh(vertices, mesh.faces[keep], mesh.source))


def components(mesh: Mesh) -> int:
    """How many connected parts the faces make."""
    return len(np.unique(_labels(mesh)[mesh.faces[:, 0]]))


def _labels(mesh: Mesh) -> np.ndarray:
    """(N,) number of each vertex's connected part."""
    n = len(mesh.vertices)
    graph = sparse.coo_matrix((np.ones(len(mesh.edges)), mesh.edges.T), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def largest_component(mesh: Mesh) -> Mesh:
    """The connected part with the most vertices."""
    labels = _labels(mesh)
    biggest = np.bincount(labels).argmax()
    return without_unused(Mesh(mesh.vertices, mesh.faces[labels[mesh.faces[:, 0]] == biggest], mesh.source))


def without_pinches(mesh: Mesh) -> Mesh:
    """The mesh without the smaller part of the faces around corners in which two borders touch."""
    while True:
        starts = border_edges(mesh.faces)[:, 0]
        pinched = np.flatnonzero(np.bincount(starts, minlength=len(mesh.vertices)) > 1)
        if not len(pinched):
            return mesh
        drop = np.concatenate([_smaller_fans(mesh.faces, int(vertex)) for vertex in pinched])
        mesh = without_unused(Mesh(mesh.vertices, np.delete(mesh.faces, drop, axis=0), mesh.source))


def _smaller_fans(faces: np.ndarray, vertex: int) -> np.ndarray:
    """Indices of the faces around a vertex that do not belong to the largest group joined by edges."""
    around = np.flatnonzero((faces == vertex).any(axis=1))
    joined = (faces[around][:, None, :, None] == faces[around][None, :, None, :]).sum(axis=(2, 3)) >= 2
    labels = connected_components(sparse.csr_matrix(joined), directed=False)[1]
    return around[labels != np.bincount(labels).argmax()]


def without_unused(mesh: Mesh) -> Mesh:
    """The same faces without vertices that no face uses; the order of the others stays."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3), mesh.source)


def border_edges(faces: np.ndarray) -> np.ndarray:
    """(E, 2) int64 edges with one face, directed as in that face."""
    halves = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, first, counts = np.unique(np.sort(halves, axis=1), axis=0, return_index=True, return_counts=True)
    return halves[first[counts == 1]]


def border_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Vertex indices around every border loop of a manifold mesh, longest loop first."""
    following = dict(border_edges(faces).tolist())
    loops = []
    while following:
        vertex = next(iter(following))
        loop = []
        while vertex in following:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return sorted(loops, key=len, reverse=True)
