"""Shapes between two poses of one mesh, without a skeleton: Poisson shape interpolation.

Xu, Zhang, Wang and Bao, "Poisson Shape Interpolation", SPM 2005: the rotation of every triangle is interpolated by its
logarithm, its stretch linearly, and the vertices are those whose edges come nearest to the triangles' in between.
Moving vertices along straight lines instead would shrink a limb that turns.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from render.mesh.factor import Factor
from render.mesh.rigid import rigid_rotation

_COTANGENTS = (0.05, 20.0)  # weights of slivers are kept within, so that the system stays definite
_FLAT = 1e-12  # m², twice the area below which a triangle has no direction


class ShapeInterpolation:
    """A mesh between two poses: `at` 0 it is the one, at 1 the other, exactly.

    The whole turns about its centroid, which moves on a straight line, evenly; what is left of every triangle's
    rotation is interpolated on its own, going on from triangle to triangle, so that a forearm may turn by more than
    180 degrees. Pieces that do not hang together, such as eyes, keep their place by the nearest vertex of the largest.

    Args:
        start, end: (B, 3) metres. faces: (G, 3) of both.
        same: (B,) for each vertex the first of those that are the same point, at seams that were split; None where
            every vertex is on its own.
    """

    def __init__(
        self, start: np.ndarray, end: np.ndarray, faces: np.ndarray, *, same: np.ndarray | None = None
    ) -> None:
        self._ends = np.asarray(start, np.float64), np.asarray(end, np.float64)
        chosen, self._of_vertex = np.unique(
            np.arange(len(start)) if same is None else same, return_inverse=True
        )
        first, last = (points[chosen] for points in self._ends)
        self._centres = first.mean(axis=0), last.mean(axis=0)
        turn = rigid_rotation(first, last)
        self._turn = Rotation.from_matrix(turn).as_rotvec()
        first, last = first - self._centres[0], (last - self._centres[1]) @ turn
        triangles = self._of_vertex[faces]
        triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
        links = _links(first, triangles)
        self._rotvecs = _rotation_vectors(first, last, triangles, links)
        rotations = Rotation.from_rotvec(self._rotvecs).as_matrix()
        corners = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
        self._tail = np.concatenate([*(triangles[:, a] for a, _, _ in corners), links[:, 0]])
        self._head = np.concatenate([*(triangles[:, b] for _, b, _ in corners), links[:, 1]])
        self._face = np.concatenate([*[np.arange(len(triangles))] * 3, links[:, 3]])
        weights = [_cotangents(first, triangles[:, [a, b, c]]) for a, b, c in corners]
        self._weights = np.concatenate([*weights, np.ones(len(links))])
        self._before = first[self._head] - first[self._tail]
        # The edge at the end, turned back as its triangle was turned: between the two lies its stretch.
        self._after = np.einsum("eba,eb->ea", rotations[self._face], last[self._head] - last[self._tail])
        self._incidence = _incidence(self._tail, self._head, len(chosen))
        system = (self._incidence.T @ self._incidence.multiply(self._weights[:, None])).tolil()
        system[0, 0] += 1.0  # the energy does not know where the whole is
        self._factor = Factor(system.tocsr(), torch.device("cpu"), torch.float64)
        solved = self._raw(1.0)
        self._missing = self._ends[1] - solved  # rounding, and seams that part

    def at(self, fraction: float) -> np.ndarray:
        """(B, 3) float64, metres: the shape at a fraction of the movement, from 0 to 1."""
        return self._ends[0].copy() if fraction == 0 else self._raw(fraction) + fraction * self._missing

    def _raw(self, fraction: float) -> np.ndarray:
        rotations = Rotation.from_rotvec(fraction * self._rotvecs).as_matrix()
        stretched = (1 - fraction) * self._before + fraction * self._after
        edges = np.einsum("eab,eb->ea", rotations[self._face], stretched)
        right = self._incidence.T @ (self._weights[:, None] * edges)
        solved = self._factor.solve(torch.from_numpy(right[None]))[0].numpy()
        turn = Rotation.from_rotvec(fraction * self._turn).as_matrix()
        centre = (1 - fraction) * self._centres[0] + fraction * self._centres[1]
        return ((solved - solved.mean(axis=0)) @ turn.T + centre)[self._of_vertex]


def _incidence(tail: np.ndarray, head: np.ndarray, count: int) -> csr_array:
    """(E, N) matrix that takes vertices to edges, head minus tail."""
    rows = np.tile(np.arange(len(tail)), 2)
    values = np.repeat([-1.0, 1.0], len(tail))
    return csr_array((values, (rows, np.concatenate([tail, head]))), shape=(len(tail), count))


def _cotangents(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(G,) cotangents of the angles at the third corners, within bounds: the Poisson system's weights."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    area = np.linalg.norm(np.cross(a - c, b - c), axis=1)
    cosine = ((a - c) * (b - c)).sum(axis=1)
    return np.clip(cosine / np.maximum(area, _FLAT), *_COTANGENTS)


def _links(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(L, 4) int64, what joins each piece to the largest: its nearest vertex, the vertex there, and a triangle of each.

    The triangle is -1 where the piece is a vertex in no triangle.
    """
    count = len(vertices)
    ends = triangles[:, [0, 1]].T.ravel(), triangles[:, [1, 2]].T.ravel()
    _, piece = connected_components(
        coo_array((np.ones(len(ends[0])), ends), shape=(count,) * 2), directed=False
    )
    largest = np.bincount(piece[triangles[:, 0]]).argmax()
    triangle = np.full(count, -1)
    triangle[triangles] = np.arange(len(triangles))[:, None]
    main = np.flatnonzero(piece == largest)
    others = np.flatnonzero(piece != largest)
    distance, nearest = cKDTree(vertices[main]).query(vertices[others])
    order = np.lexsort((distance, piece[others]))
    _, first = np.unique(piece[others][order], return_index=True)
    chosen = order[first]
    own, there = others[chosen], main[nearest[chosen]]
    return np.stack([own, there, triangle[own], triangle[there]], axis=1)


def _rotation_vectors(
    first: np.ndarray, last: np.ndarray, triangles: np.ndarray, links: np.ndarray
) -> np.ndarray:
    """(G, 3) logarithms of the triangles' rotations from `first` to `last`, each the branch nearest to a neighbour's.

    Rotations are the polar factors of the deformation gradients; triangles without area take a neighbour's.
    """
    frames, flat = zip(*(_frames(points[triangles]) for points in (first, last)), strict=True)
    flat = flat[0] | flat[1]
    gradient = frames[1] @ np.linalg.inv(frames[0])
    gradient[flat] = np.eye(3)
    left, _, right = np.linalg.svd(gradient)
    rotations = left @ right
    rotvecs = Rotation.from_matrix(rotations).as_rotvec()
    size = np.linalg.norm(rotvecs, axis=1)
    seed = int(np.argmin(np.where(flat, np.inf, size)))
    # From triangle to triangle where they turn most alike, and last through folds, such as armpits, that turn anyhow.
    start, end = _neighbours(triangles, links).T
    # Above 0, or SciPy drops it.
    unlike = 3 - np.einsum("pab,pab->p", rotations[start], rotations[end]) + 1e-6
    unlike += 10.0 * (flat[start] | flat[end])
    tree = minimum_spanning_tree(csr_array((unlike, (start, end)), shape=(len(triangles),) * 2))
    order, before = breadth_first_order(tree, seed, directed=False)
    depth = np.zeros(len(triangles), np.int64)
    for triangle in order[1:]:
        depth[triangle] = depth[before[triangle]] + 1
    axis = rotvecs / np.maximum(size, 1e-12)[:, None]
    by_depth = order[np.argsort(depth[order], kind="stable")]
    for ring in np.split(by_depth, np.flatnonzero(np.diff(depth[by_depth])) + 1)[1:]:
        known = rotvecs[before[ring]]
        branches = np.stack([rotvecs[ring] + 2 * np.pi * turns * axis[ring] for turns in (0, -1, 1)])
        best = np.linalg.norm(branches - known, axis=-1).argmin(axis=0)
        rotvecs[ring] = np.where(flat[ring, None], known, branches[best, np.arange(len(ring))])
    return rotvecs


def _frames(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(G, 3, 3) two edges and a normal of about their length as columns; and which triangles have no area."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    size = np.linalg.norm(normal, axis=1)
    flat = size < _FLAT
    normal = normal / np.sqrt(np.maximum(size, _FLAT))[:, None]
    frames = np.stack([first, second, normal], axis=-1)
    frames[flat] = np.eye(3)
    return frames, flat


def _neighbours(triangles: np.ndarray, links: np.ndarray) -> np.ndarray:
    """(P, 2) which triangles share an edge, or are linked; each pair once."""
    halves = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(halves.T)
    same = (halves[order][1:] == halves[order][:-1]).all(axis=1)
    pairs = np.stack([order[:-1][same] // 3, order[1:][same] // 3], axis=1)
    pairs = np.concatenate([pairs, links[links[:, 2] >= 0][:, 2:]])
    return np.unique(np.sort(pairs, axis=1), axis=0)
