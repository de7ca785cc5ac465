"""Patches of a garment's images that the kernel head predicts one by one, and how neighbouring patches blend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from imgtransfer.network.local_view import token_centres
from render import TemplateImager

BLEND_M = 0.06  # by how much farther than its nearest patch a pixel may be from another that still counts
_ROUNDS = 20  # of Lloyd's iteration


@dataclass(frozen=True)
class Patches:
    """P overlapping patches over the L pixels of the silhouette, of all views together.

    Args:
        tokens: (P,) int64, the token whose view of the body each patch is predicted from.
        pixels: for each patch the pixels that it predicts, int64, ascending, in [0, L).
        blend: for each patch how much it counts at its pixels, float32; over all patches 1 at every pixel.
    """

    tokens: np.ndarray
    pixels: tuple[np.ndarray, ...]
    blend: tuple[np.ndarray, ...]


def template_patches(imager: TemplateImager, *, token: int, count: int) -> Patches:
    """The patches of a template: the same wherever it is imaged.

    Args:
        imager: of the template. token: side of a token's square patch of the images, pixels. count: of patches.
    """
    mask = imager.mask.numpy()
    projected = imager.operator(torch.from_numpy(imager.mesh.vertices)).numpy()
    centres, at = token_centres(mask, projected, token)
    return patches_over(projected[mask], centres.reshape(-1, 3), at.reshape(-1) >= 0, count)


def patches_over(points: np.ndarray, centres: np.ndarray, covered: np.ndarray, count: int) -> Patches:
    """Spread patches evenly over the cloth.

    A pixel belongs to the patch whose centre is nearest at rest, and less to those that are at most `BLEND_M`
    farther, so that what neighbouring patches predict goes over into each other without seams.

    Args:
        points: (L, 3) metres, the template at the pixels of the silhouette.
        centres: (K, 3) metres, the template at the centres of all tokens.
        covered: (K,) bool, which tokens show any cloth.
        count: of patches; fewer where fewer tokens are covered.
    """
    tokens = np.flatnonzero(covered)
    means = points[_farthest(points, min(count, len(tokens)))]
    for _ in range(_ROUNDS):
        nearest = cKDTree(means).query(points)[1]
        number = np.bincount(nearest, minlength=len(means))
        sums = np.stack([np.bincount(nearest, axis, minlength=len(means)) for axis in points.T], axis=-1)
        means = np.where(number[:, None] > 0, sums / np.maximum(number, 1)[:, None], means)
    chosen = np.unique(tokens[cKDTree(centres[tokens]).query(means)[1]])
    weight = blend_weights(points, centres[chosen])
    pixels = tuple(np.flatnonzero(column) for column in weight.T)
    blend = tuple(column[at].astype(np.float32) for column, at in zip(weight.T, pixels, strict=True))
    return Patches(chosen, pixels, blend)


def blend_weights(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(L, 3) points and (P, 3) centres, metres -> (L, P) how much each counts there: continuous, of sum 1."""
    distance = np.linalg.norm(points[:, None] - centres, axis=-1)
    weight = np.maximum(BLEND_M - (distance - distance.min(axis=1, keepdims=True)), 0)
    return weight / weight.sum(axis=1, keepdims=True)


def mirrored_pixels(mask: np.ndarray) -> np.ndarray:
    """For each pixel of the silhouette the one that shows the other side of it, or lies nearest to where that would be.

    Args:
        mask: (S, H, W) bool, of views in the plane of symmetry.

    Returns:
        (L,) int64 in [0, L).
    """
    at = np.argwhere(mask)
    other = at.copy()
    other[:, 2] = mask.shape[2] - 1 - at[:, 2]
    far = [mask.shape[1] + mask.shape[2], 1, 1]  # no pixel of another view is nearest
    return cKDTree(at * far).query(other * far)[1]


def _farthest(points: np.ndarray, count: int) -> np.ndarray:
    """(count,) indices of points each of which lies farthest from those before; the first is the highest."""
    chosen = [int(points[:, 1].argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.square(points - points[chosen[-1]]).sum(axis=1))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)
