"""Carry a garment from one body shape to another with the same faces, so that its vertices correspond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, identity
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from imgtransfer.garments.field import Field
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.finish import relaxed
from render.mesh.mesh import Mesh

_NEIGHBOURS = 32  # of the skin's vertices, whose displacement from shape to shape a vertex of cloth follows
_NEAR = 0.05  # metres; neighbours count by a Gaussian of this width beyond the nearest one
_SMOOTHINGS = 60  # of the displacement, over the garment


def refitted(
    mesh: Mesh, start: Figure, end: Figure, field: Field, borders: Sequence[tuple[np.ndarray, float | None]]
) -> Mesh:
    """The garment of one body on another shape of that body.

    Args:
        mesh: the garment on `start`.
        start, end: figures of one topology.
        field: the garment's on `end`; vertices are moved onto its zero level.
        borders: for every opening its vertices and the height at which they shall lie, metres; None leaves them where
            they follow the body.

    Returns:
        A mesh with the faces of `mesh`.
    """
    vertices, mean = carried(mesh, start.vertices, end.vertices), _mean_of_neighbours(mesh)
    vertices[:, 1] += _lift(vertices[:, 1], mean, borders)
    vertices = relaxed(Mesh(vertices, mesh.faces), field)
    vertices[:, 1] += _lift(vertices[:, 1], mean, borders)  # the field's slope moved borders a little
    return Mesh(vertices, mesh.faces, mesh.source)


def carried(mesh: Mesh, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(N, 3) the vertices of a garment that follow the skin beneath from one shape of the body to another.

    Args:
        mesh: the garment on `start`.
        start, end: (B, 3) vertices of both shapes at rest, metres.
    """
    distance, nearest = cKDTree(start).query(mesh.vertices, k=_NEIGHBOURS)
    weights = np.exp(-(((distance - distance[:, :1]) / _NEAR) ** 2))
    weights /= weights.sum(axis=1, keepdims=True)
    displacement = np.einsum("nk,nkx->nx", weights, (end - start)[nearest])
    mean = _mean_of_neighbours(mesh)
    for _ in range(_SMOOTHINGS):
        displacement = 0.5 * (displacement + mean @ displacement)
    moved: np.ndarray = mesh.vertices + displacement
    return moved


def _mean_of_neighbours(mesh: Mesh) -> csr_matrix:
    """(N, N), which gives every vertex the mean of what its neighbours have."""
    n = len(mesh.vertices)
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    neighbours = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsr()
    return neighbours.multiply(1 / neighbours.sum(axis=1)).tocsr()


def _lift(
    heights: np.ndarray, mean: csr_matrix, borders: Sequence[tuple[np.ndarray, float | None]]
) -> np.ndarray:
    """(N,) metres upwards that bring the borders to their heights, harmonic in between."""
    lift, fixed = np.zeros(len(heights)), np.zeros(len(heights), bool)
    for loop, height in borders:
        fixed[loop] = True
        lift[loop] = 0.0 if height is None else height - heights[loop]
    free = ~fixed
    inner = identity(len(heights), format="csr") - mean
    lift[free] = spsolve(inner[free][:, free].tocsc(), -inner[free][:, fixed] @ lift[fixed])
    return lift
