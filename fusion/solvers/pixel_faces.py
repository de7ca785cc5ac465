"""The pixels that show a template, face by face, as the kernels of `fusion.solvers.energy` read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch

from fusion.topology import Topology
from render.mesh.sparse import SparseProduct
from render.raster.raster import Raster


@dataclass(frozen=True, eq=False)
class PixelFaces:
    """The covered pixels of a raster, put in the order of the faces that they show.

    Args:
        places: (P,) int64, which of all S · H · W pixels, face by face.
        weights: (P, 3) float64, barycentric.
        faces: (K, 3) int32, vertices of the faces that have pixels.
        pixel_start: (K + 1,) int32: pixels of face k are pixel_start[k] to pixel_start[k + 1].
    """

    places: torch.Tensor
    weights: np.ndarray
    faces: np.ndarray
    pixel_start: np.ndarray

    @classmethod
    def of(cls, raster: Raster, topology: Topology) -> PixelFaces:
        """Group the covered pixels of all images by face.

        Args:
            raster: of S images of H × W pixels.
            topology: of the mesh that it shows.
        """
        covered = np.flatnonzero(raster.mask)
        face = raster.face_id.reshape(-1)[covered]
        order = np.argsort(face, kind="stable")
        numbers, counts = np.unique(face, return_counts=True)
        faces = topology.faces[numbers]
        return cls(
            torch.from_numpy(covered[order]),
            raster.barycentric.reshape(-1, 3)[covered[order]],
            faces.astype(np.int32),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
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
