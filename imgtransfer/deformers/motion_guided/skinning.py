"""The garment from displacements of its template and weights of the seed points (section 4.1, equation 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imgtransfer.data.clip_parts import Template
from render.mesh.mesh import edges_of
from render.mesh.normals import vertex_normals


@dataclass(frozen=True, eq=False)
class Rest:
    """A garment and a body's seed points at rest.

    Args:
        vertices: (N, 3) g_0. axes: (N, 3, 3) H_0, whose columns are two tangents and the normal. seeds: (J, 3) b_0.
    """

    vertices: Tensor
    axes: Tensor
    seeds: Tensor

    def displaced(self, displacements: Tensor) -> Tensor:
        """ĝ = g_0 + H_0 d of (B, N, 3)."""
        return self.vertices + (self.axes @ displacements[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class Seeds:
    """Seed points in B frames.

    Args:
        points, normals: (B, J, 3). rotation: (B, J, 3, 3) and translation: (B, J, 3), of x' = R x + T from rest; with
            the paper's T this is R (x − b_0) + b_0 + T.
    """

    points: Tensor
    normals: Tensor
    rotation: Tensor
    translation: Tensor

    def __getitem__(self, index: Tensor | slice) -> Seeds:
        return Seeds(self.points[index], self.normals[index], self.rotation[index], self.translation[index])


def kernel_weights(points: Tensor, seeds: Tensor, radius: Tensor) -> Tensor:
    """w: kernels of the distance to each seed point at rest, divided by their sum (section 4.2).

    Args:
        points: (B, N, 3) ĝ. seeds: (J, 3). radius: (J,) ρ of the part of each, metres.

    Returns:
        (B, N, J).
    """
    # −‖ĝ − b‖² / 2ρ² as one product of (‖ĝ‖², ĝ), which is far quicker than squares and quotients of N × J numbers.
    sharpness = -0.5 / radius.square()
    factors = torch.cat([sharpness[None], (-2 * sharpness[:, None] * seeds).mT])
    known = torch.cat([points.square().sum(-1, keepdim=True), points], -1)
    exponents = torch.addmm(sharpness * seeds.square().sum(-1), known.flatten(0, -2), factors)
    return exponents.unflatten(0, points.shape[:-1]).softmax(-1)


def posed(points: Tensor, weights: Tensor, seeds: Seeds) -> tuple[Tensor, Tensor]:
    """g of equation 1, and the blended rotations, by which small displacements of ĝ arrive there.

    Args:
        points: (B, N, 3). weights: (B, N, J).

    Returns:
        (B, N, 3) and (B, N, 3, 3).
    """
    transforms = torch.cat([seeds.rotation, seeds.translation[..., None]], -1).flatten(2)
    blended = (weights @ transforms).unflatten(-1, (3, 4))
    return (blended[..., :3] @ points[..., None])[..., 0] + blended[..., 3], blended[..., :3]


def local_axes(template: Template) -> np.ndarray:
    """H_0 (N, 3, 3) float32: a tangent along one of a vertex's edges, the other tangent, the normal, as columns.

    A vertex without a normal has the coordinate axes.
    """
    vertices = template.vertices.astype(np.float64)
    normal = vertex_normals(
        torch.from_numpy(vertices), torch.from_numpy(template.faces.astype(np.int64))
    ).numpy()
    along = np.tile([1.0, 0, 0], (len(vertices), 1))
    edges = edges_of(template.faces)
    for start, end in ((edges[::-1, 0], edges[::-1, 1]), (edges[::-1, 1], edges[::-1, 0])):
        along[start] = vertices[end] - vertices[start]
    along -= (along * normal).sum(1, keepdims=True) * normal
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along /= np.where(length > 0, length, 1)
    axes = np.stack([along, np.cross(normal, along), normal], -1)
    known = (length[:, 0] > 1e-9) & (np.linalg.norm(normal, axis=1) > 0.5)
    return np.where(known[:, None, None], axes, np.eye(3)).astype(np.float32)
