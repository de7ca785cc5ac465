"""Vertex normals of meshes that share their faces."""

from __future__ import annotations

import numpy as np
import torch

from render.mesh.mesh import safe_normalize
from render.mesh.sparse import SparseProduct


class VertexNormals:
    """`vertex_normals` for one set of faces: the same numbers in half the time, as the sums are kept ready.

    Args:
        faces: (F, 3) int64.
        n_vertices: N.
    """

    def __init__(self, faces: np.ndarray, n_vertices: int) -> None:
        of_face = np.repeat(np.arange(len(faces)), 3)
        self._sums = SparseProduct(faces.ravel(), of_face, np.ones(faces.size), (n_vertices, len(faces)))
        corners = torch.from_numpy(np.ascontiguousarray(faces.T))
        self._corners = {corners.device: corners}

    def __call__(self, vertices: torch.Tensor) -> torch.Tensor:
        """(..., N, 3) float32 or float64 to unit vectors (..., N, 3), exactly 0 where no face has an area."""
        if vertices.device not in self._corners:
            self._corners[vertices.device] = self._corners[torch.device("cpu")].to(vertices.device)
        if vertices.ndim == 2 or vertices.numel() == 0 or vertices.device.type != "cpu":
            return self._together(vertices)
        # One frame after the other stays in the processor's cache.
        frames = [self._together(frame) for frame in vertices.flatten(0, -3)]
        return torch.stack(frames).reshape(vertices.shape)

    def _together(self, vertices: torch.Tensor) -> torch.Tensor:
        corners = self._corners[vertices.device]
        first, second, third = (vertices.index_select(-2, corner) for corner in corners)
        face_normal = torch.linalg.cross(second - first, third - first, dim=-1)  # twice the area long
        return safe_normalize(self._sums(face_normal))
