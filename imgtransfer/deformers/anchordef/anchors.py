"""Anchors around a garment's template: where they are, which vertices belong to them, and what they move with."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree


def initial_anchors(vertices: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Centres of clusters of the template's vertices by k-means (section 3.1).

    Args:
        vertices: (N, 3), metres. count: of anchors, at most N.

    Returns:
        (count, 3) float64, ordered from the lowest to the highest.
    """
    points = vertices.astype(np.float64)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "One of the clusters is empty", UserWarning)
        centres, _ = kmeans2(points, count, minit="++", rng=np.random.default_rng(seed))
    return centres[np.lexsort(centres.T[[0, 2, 1]])]


def nearest(points: np.ndarray, targets: np.ndarray, count: int) -> np.ndarray:
    """(M, 3) points -> (M, min(count, len(targets))) int64, each point's nearest targets, the nearest first."""
    count = min(count, len(targets))
    _, index = cKDTree(targets).query(points, k=count)
    return index.reshape(len(points), count).astype(np.int64)


def tight_anchors(anchors: np.ndarray, joints: np.ndarray, within: float) -> np.ndarray:
    """Which anchors follow the body's nearest vertex: those near a joint (section 3.1, after equation 4).

    Args:
        anchors: (A, 3), joints: (J, 3), metres, both at rest. within: metres.

    Returns:
        (A,) bool.
    """
    distance, _ = cKDTree(joints).query(anchors)
    return distance <= within
