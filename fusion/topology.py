"""What is constant for one garment template: edges, rest lengths and the matrices of the losses."""

from __future__ import annotations

import numpy as np
import torch

from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh
from render.mesh.normals import VertexNormals
from render.mesh.sparse import SparseProduct, differences


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
        #: (E,) float64, metres, lengths of the template's edges.
        self.rest_lengths = torch.from_numpy(edge_lengths(mesh.vertices, edges))
        #: (E, N): row e is the first end of edge e minus the second.
        self.difference = differences(edges, n)
        ends = np.concatenate([edges, edges[:, ::-1]])
        #: (N, N): 1 where two vertices share an edge.
        self.adjacency = SparseProduct(ends[:, 0], ends[:, 1], np.ones(len(ends)), (n, n))
        #: Area-weighted unit vertex normals of vertices (..., N, 3).
        self.normals = VertexNormals(faces, n)


def vertices_first(attributes: torch.Tensor) -> torch.Tensor:
    """The same (T, N, C) tensor, laid out in memory as (N, T, C), so that sparse products need no copy."""
    return attributes.transpose(0, 1).contiguous().transpose(0, 1)
