"""Seed points on the body: evenly spread, each of a part of the body."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from imgtransfer.data.clip import Clip
from render.mesh.mesh import edges_of


def farthest_points(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """Vertices spread over a mesh by farthest point sampling along its edges (section 4.1).

    The first is the vertex farthest from the mean; a part that no edge joins to the others counts as infinitely far.

    Args:
        vertices: (B, 3), metres. faces: (G, 3) int. count: of points, at most those with an edge.

    Returns:
        (count,) int64, in the order in which they were taken.
    """
    edges = edges_of(faces)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    # Zero lengths would be no edges in a sparse matrix.
    both = (np.maximum(length, 1e-9), (edges[:, 0], edges[:, 1]))
    graph = csr_array(both, shape=(len(vertices), len(vertices)))
    joined = np.unique(edges)
    centre = vertices[joined].mean(0)
    taken = [int(joined[np.linalg.norm(vertices[joined] - centre, axis=1).argmax()])]
    distance = np.full(len(vertices), np.inf)
    while len(taken) < min(count, len(joined)):
        distance = np.minimum(distance, dijkstra(graph, directed=False, indices=taken[-1]))
        taken.append(int(joined[distance[joined].argmax()]))
    return np.array(taken, np.int64)


def body_parts(clip: Clip, seeds: np.ndarray) -> np.ndarray:
    """The part of the body of each seed point, which shares a kernel radius (section 4.2).

    The paper names five parts by hand. Here a part is what follows one joint: the column of the greatest blend
    weight, or the nearest joint at rest where there are no weights, or the whole body.

    Args:
        seeds: (J,) body vertices.

    Returns:
        (J,) int64 from 0 on, without gaps.
    """
    skeleton = clip.skeleton
    if skeleton.blend_weights is not None:
        part = skeleton.blend_weights[seeds].argmax(1)
    elif skeleton.joints_rest is not None:
        _, part = cKDTree(skeleton.joints_rest).query(clip.body.rest[seeds])
    else:
        part = np.zeros(len(seeds))
    return np.unique(part, return_inverse=True)[1].astype(np.int64)


def spacing(points: np.ndarray) -> float:
    """The median distance of points (J, 3) to their nearest other one, metres; 1 for a single point."""
    if len(points) < 2:
        return 1.0
    distance, _ = cKDTree(points).query(points, k=2)
    return max(float(np.median(distance[:, 1])), 1e-6)
