"""Skinning weights of a garment: those of the body vertices that are nearest at rest, diffused over the cloth."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from imgtransfer.data.clip import Clip
from imgtransfer.data.skinning import joint_transforms
from render import InputError


def garment_weights(clip: Clip, *, neighbours: int, diffusion: float) -> np.ndarray:
    """Weights of a clip's garment on the columns of its body's, (N, K) float64; rows sum to 1.

    Args:
        clip: with blend_weights.
        neighbours: body vertices that a garment vertex takes its weights from.
        diffusion: how far weights spread over the cloth, metres; 0 leaves them.

    Raises:
        InputError: a body without weights.
    """
    weights, _ = body_skinning(clip)
    template = clip.template.vertices.astype(np.float64)
    taken = nearest_weights(template, clip.body.rest.astype(np.float64), weights, neighbours)
    if diffusion > 0:
        taken = diffused(taken, template, clip.template.faces, diffusion)
    return taken


def body_skinning(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """What moves a clip's body: weights (B, K) float64 and transforms (T, K, 3, 4) float64, rest to posed.

    Raises:
        InputError: the clip lacks either.
    """
    if clip.skeleton.blend_weights is None:
        raise InputError(
            f"{clip.name}: lacks blend_weights, which skinning takes from the body; import the clip with its skeleton, "
            "or choose a method that needs none"
        )
    return clip.skeleton.blend_weights.astype(np.float64), joint_transforms(clip)


def nearest_weights(points: np.ndarray, body: np.ndarray, weights: np.ndarray, neighbours: int) -> np.ndarray:
    """Mean of the weights of the nearest body vertices, each counting as the inverse of its distance.

    Args:
        points: (N, 3), metres. body: (B, 3) at rest. weights: (B, K).
        neighbours: how many; all where there are fewer.

    Returns:
        (N, K) float64, rows that sum to 1 where the body's do.
    """
    count = min(neighbours, len(body))
    distance, nearest = (found.reshape(len(points), count) for found in cKDTree(body).query(points, k=count))
    closeness = 1 / np.maximum(distance, 1e-9)  # a point on a body vertex takes that one's
    closeness /= closeness.sum(axis=1, keepdims=True)
    return np.einsum("nk,nkj->nj", closeness, weights[nearest])


def diffused(values: np.ndarray, vertices: np.ndarray, faces: np.ndarray, length: float) -> np.ndarray:
    """Values after heat has spread over a mesh by `length`: one implicit step, (A + length² L) v' = A v.

    A has the areas of the vertices, L the cotangents of the angles opposite the edges. Negative cotangents count as 0,
    so that v' lies between the least and the greatest v, and the sum of each row stays.

    Args:
        values: (N, K). vertices: (N, 3), metres. faces: (F, 3).
        length: metres.

    Returns:
        (N, K) float64.
    """
    count = len(vertices)
    cotangents, area = _cotangents(vertices, faces)
    rows, columns = np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)  # the edge opposite each corner
    half = sparse.coo_matrix(
        (0.5 * np.maximum(cotangents, 0).ravel(), (rows.ravel(), columns.ravel())), shape=(count, count)
    )
    joined = (half + half.T).tocsr()
    laplacian = sparse.diags(np.asarray(joined.sum(axis=1)).ravel()) - joined
    areas = np.bincount(faces.ravel(), np.repeat(area / 3, 3), minlength=count)
    areas = np.maximum(areas, 1e-6 * areas.max(initial=1e-12))  # vertices of no face keep their values
    mass = sparse.diags(areas)
    return np.asarray(splu((mass + length**2 * laplacian).tocsc()).solve(mass @ values))


def _cotangents(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cotangent of each corner's angle, (F, 3), and the faces' areas, (F,)."""
    corners = vertices[faces]
    to_next, to_last = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    twice = np.linalg.norm(np.cross(to_next, to_last), axis=-1)
    dots = (to_next * to_last).sum(-1)
    return np.where(twice > 1e-14, dots / np.maximum(twice, 1e-14), 0.0), twice[:, 0] / 2
