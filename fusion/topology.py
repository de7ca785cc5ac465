"""What is constant for one garment template: edges, rest lengths and the matrices of the losses."""

from __future__ import annotations

import numpy as np
import torch

from render.mesh.mesh import Mesh, safe_normalize
from render.mesh.sparse import SparseProduct


class Topology:
    """Edges, rest lengths and normals of one template as sparse products; built once, used at every step.

    Device and dtype (float32 or float64) follow the tensors it is given. Tensors are (..., N, 3); they are
    fastest when all numbers of one vertex lie together in memory, as `vertices_first` arranges them.

    Args:
        mesh: the template.
    """

    def __init__(self, mesh: Mesh) -> None:
        n, edges, faces = len(mesh.vertices), mesh.edges, mesh.faces
        self.n_vertices, self.n_edges = n, len(edges)
        self.edges, self.faces = edges, faces
        self.rest_vertices = mesh.vertices
        lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
        #: (E,) float64, metres, lengths of the template's edges.
        self.rest_lengths = torch.from_numpy(lengths)
        #: (E, N): row e is the first end of edge e minus the second.
        self.difference = _differences(edges, n)
        ends = np.concatenate([edges, edges[:, ::-1]])
        #: (N, N): 1 where two vertices share an edge.
        self.adjacency = SparseProduct(ends[:, 0], ends[:, 1], np.ones(len(ends)), (n, n))
        self._sides = [_differences(faces[:, [corner, 0]], n) for corner in (1, 2)]
        of_face = np.repeat(np.arange(len(faces)), 3)
        self._to_vertices = SparseProduct(faces.ravel(), of_face, np.ones(faces.size), (n, len(faces)))

    def normals(self, vertices: torch.Tensor) -> torch.Tensor:
        """Area-weighted unit vertex normals: the numbers of `render.vertex_normals`, about twice as fast.

        Args:
            vertices: (..., N, 3).

        Returns:
            (..., N, 3) unit vectors; exactly 0 where no face with an area meets.
        """
        first, second = (side(vertices) for side in self._sides)
        return safe_normalize(self._to_vertices(torch.linalg.cross(first, second)))


def vertices_first(attributes: torch.Tensor) -> torch.Tensor:
    """The same (T, N, C) tensor, laid out in memory as (N, T, C), so that sparse products need no copy."""
    return attributes.transpose(0, 1).contiguous().transpose(0, 1)


def _differences(pairs: np.ndarray, n_vertices: int) -> SparseProduct:
    """(P, 2) vertex pairs -> (P, N) matrix whose row p is the first minus the second."""
    rows = np.repeat(np.arange(len(pairs)), 2)
    return SparseProduct(rows, pairs.ravel(), np.tile([1.0, -1.0], len(pairs)), (len(pairs), n_vertices))
