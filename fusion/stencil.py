"""What one vertex of a template reads of its neighbours, as index lists for the kernels of `fusion.energy`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch

from fusion.topology import Topology
from render.operator import SparseProduct
from render.raster import Raster


class Stencil:
    """Neighbours and corners of every vertex of one template; built once.

    Lists of all vertices stand behind each other; vertex i owns entries start[i] to start[i + 1].

    Args:
        topology: of the template, N vertices, E edges, F faces.

    Attributes:
        neighbour_start (N + 1,), neighbours (2E,) int32; rest_lengths (2E,) float64, metres, of the same edges.
        corner_start (N + 1,), corners (3F, 2) int32: the other two vertices of each face around a vertex, so that the
            three are counter-clockwise.
    """

    def __init__(self, topology: Topology) -> None:
        edges, faces, n = topology.edges, topology.faces, topology.n_vertices
        ends = np.concatenate([edges, edges[:, ::-1]])
        self.neighbour_start, order = _grouped(ends[:, 0], n)
        self.neighbours = ends[order, 1].astype(np.int32)
        self.rest_lengths = np.tile(topology.rest_lengths.numpy(), 2)[order]
        self.corner_start, order = _grouped(faces.reshape(-1), n)
        others = np.stack([faces[:, [1, 2, 0]].reshape(-1), faces[:, [2, 0, 1]].reshape(-1)], axis=1)
        self.corners = others[order].astype(np.int32)


@dataclass(frozen=True, eq=False)
class ShownFaces:
    """The covered pixels of a raster, put in the order of the faces that they show.

    Args:
        places: (P,) int64, which of all S · H · W pixels, face by face.
        weights: (P, 3) float64, barycentric.
        faces: (K, 3) int32, vertices of the faces that have pixels.
        pixel_start: (K + 1,) int32: pixels of face k are pixel_start[k] to pixel_start[k + 1].
        shown_start, shown: (N + 1,) and (3K,) int32: for each vertex, which of the 3K corners of `faces` are it.
    """

    places: torch.Tensor
    weights: np.ndarray
    faces: np.ndarray
    pixel_start: np.ndarray
    shown_start: np.ndarray
    shown: np.ndarray

    @classmethod
    def of(cls, raster: Raster, topology: Topology) -> ShownFaces:
        """Group the covered pixels of all images by face."""
        covered = np.flatnonzero(raster.mask)
        face = raster.face_id.reshape(-1)[covered]
        order = np.argsort(face, kind="stable")
        numbers, counts = np.unique(face, return_counts=True)
        faces = topology.faces[numbers]
        shown_start, shown = _grouped(faces.reshape(-1), topology.n_vertices)
        return cls(
            torch.from_numpy(covered[order]),
            raster.barycentric.reshape(-1, 3)[covered[order]],
            faces.astype(np.int32),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            shown_start,
            shown.astype(np.int32),
        )

    def product(self, n_vertices: int) -> SparseProduct:
        """(P, N) the interpolation B at `places`."""
        corners = np.repeat(self.faces, self.pixels_per_face(), axis=0)
        rows = np.repeat(np.arange(len(self.places)), 3)
        return SparseProduct(rows, corners.ravel(), self.weights.ravel(), (len(self.places), n_vertices))

    def pixels_per_face(self) -> np.ndarray:
        """(K,) how many pixels show each of `faces`."""
        return np.diff(self.pixel_start)


def gradient_laplacian(
    vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray
) -> scipy.sparse.csr_matrix:
    """(N, N) matrix of Σ weight · |∇w|² over faces, for a function w that is linear on each.

    Args:
        vertices: (N, 3) metres.
        faces: (K, 3) integers.
        weights: (K,) at least 0.

    Returns:
        Positive semi-definite, in 1/m²; faces so thin that their gradients mean nothing are left out.
    """
    corners = vertices[faces]
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # (K, 3, 3): the side across from each corner
    double = np.linalg.norm(np.cross(opposite[:, 0], opposite[:, 1]), axis=1)
    usable = double > 1e-3 * (opposite**2).sum(-1).max(-1)
    gram = np.einsum("kia,kja->kij", opposite[usable], opposite[usable]) / (double[usable, None, None] ** 2)
    gram *= weights[usable, None, None]
    rows = np.repeat(faces[usable], 3, axis=1)
    columns = np.tile(faces[usable], (1, 3))
    shape = (len(vertices), len(vertices))
    return scipy.sparse.csr_matrix((gram.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=shape)


def _grouped(owner: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each owner's entries start (n + 1,) int32, and the order that brings them together."""
    counts = np.bincount(owner, minlength=n)
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return start, np.argsort(owner, kind="stable")
