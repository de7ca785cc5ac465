"""Vertex normals: at once, or for meshes that share their faces."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch

from render.mesh.sparse import SparseProduct, differences


def vertex_normals(vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Area-weighted mean of the face normals around each vertex, as unit vectors.

    Args:
        vertices: (..., N, 3) floating point.
        faces: (F, 3) int64, on the same device.

    Returns:
        (..., N, 3), same dtype; exactly 0 at vertices whose faces have no area (or that have no face).
    """
    corners = vertices[..., faces, :]  # (..., F, 3 corners, 3)
    face_normal = torch.linalg.cross(
        corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :], dim=-1
    )  # length is twice the area, which is the weighting
    total = torch.zeros_like(vertices)
    for corner in range(3):
        total = total.index_add(-2, faces[:, corner], face_normal)
    return safe_normalize(total)


def safe_normalize(vectors: torch.Tensor) -> torch.Tensor:
    """(..., 3) scaled to unit length; 0 stays 0, with gradient 0 there."""
    squared = vectors.square().sum(-1, keepdim=True)
    zero = squared == 0
    length = torch.where(zero, torch.ones_like(squared), squared).sqrt()
    return torch.where(zero, torch.zeros_like(vectors), vectors / length)


class VertexNormals:
    """`vertex_normals` for one set of faces: the same numbers in half the time, as the sums are kept ready.

    Args:
        faces: (F, 3) int64.
        n_vertices: N.
    """

    def __init__(self, faces: np.ndarray, n_vertices: int) -> None:
        self._faces, self._n_vertices = faces, n_vertices
        of_face = np.repeat(np.arange(len(faces)), 3)
        self._sums = SparseProduct(faces.ravel(), of_face, np.ones(faces.size), (n_vertices, len(faces)))
        corners = torch.from_numpy(np.ascontiguousarray(faces.T))
        self._corners = {corners.device: corners}

    def __call__(self, vertices: torch.Tensor) -> torch.Tensor:
        """(..., N, 3) float32 or float64 to unit vectors (..., N, 3), exactly 0 where no face has an area."""
        if vertices.requires_grad or not vertices.is_contiguous():
            # Products have products as gradients, and keep the layout of all numbers of one vertex side by side.
            return self._of_sides(*(side(vertices) for side in self._sides))
        if vertices.ndim == 2 or vertices.numel() == 0 or vertices.device.type != "cpu":
            return self._of_corners(vertices)
        # One frame after the other stays in the processor's cache.
        frames = [self._of_corners(frame) for frame in vertices.flatten(0, -3)]
        return torch.stack(frames).reshape(vertices.shape)

    @cached_property
    def _sides(self) -> list[SparseProduct]:
        """(F, N) each: row f is the second or third corner of face f minus the first."""
        return [differences(self._faces[:, [corner, 0]], self._n_vertices) for corner in (1, 2)]

    def _of_corners(self, vertices: torch.Tensor) -> torch.Tensor:
        if vertices.device not in self._corners:
            self._corners[vertices.device] = self._corners[torch.device("cpu")].to(vertices.device)
        first, second, third = (
            vertices.index_select(-2, corner) for corner in self._corners[vertices.device]
        )
        return self._of_sides(second - first, third - first)

    def _of_sides(self, first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
        twice_areas = torch.linalg.cross(first, second, dim=-1)
        return safe_normalize(self._sums(twice_areas))
