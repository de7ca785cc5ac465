"""The graph Laplacian of a mesh, by which losses compare details of shape."""

from __future__ import annotations

import numpy as np

from render.mesh.mesh import edges_of
from render.mesh.sparse import SparseProduct


def graph_laplacian(faces: np.ndarray, n_vertices: int) -> SparseProduct:
    """(N, N): each vertex minus the mean of its neighbours; 0 for a vertex without any.

    Args:
        faces: (F, 3) int.
    """
    edges = edges_of(faces)
    start, end = np.concatenate([edges, edges[:, ::-1]]).T
    degree = np.bincount(start, minlength=n_vertices)
    joined = np.flatnonzero(degree)
    rows = np.concatenate([joined, start])
    columns = np.concatenate([joined, end])
    values = np.concatenate([np.ones(len(joined)), -1.0 / degree[start]])
    return SparseProduct(rows, columns, values, (n_vertices, n_vertices))
