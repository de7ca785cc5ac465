"""Meshes simplified by quadric error metrics (Garland and Heckbert 1997): the vertices that anchors are drawn to."""

from __future__ import annotations

import heapq

import numpy as np

BORDER_WEIGHT = 10.0  # of the planes that stand on border edges, against that of a face
_SINGULAR = (
    1e-3  # of a quadric's least curvature to its greatest, below which its minimum is nowhere in particular
)


def simplified(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh with fewer vertices: the cheapest edge that keeps the topology is collapsed, again and again.

    Vertices in no face are left out.

    Args:
        vertices: (N, 3), metres. faces: (F, 3) int. count: of vertices that shall be left; there may be more where
            no edge can go without changing the topology.

    Returns:
        vertices (M, 3) float64 and faces (G, 3) int64.
    """
    return _Simplification(vertices.astype(np.float64), faces).run(count)


class _Simplification:
    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._points = vertices.copy()
        self._faces = {index: set(face) for index, face in enumerate(faces.tolist()) if len(set(face)) == 3}
        self._order = {index: face for index, face in enumerate(faces.tolist())}
        self._around: dict[int, set[int]] = {}  # vertex to its faces
        for index, face in self._faces.items():
            for vertex in face:
                self._around.setdefault(vertex, set()).add(index)
        self._quadrics = _quadrics(vertices, faces)
        self._version = dict.fromkeys(self._around, 0)
        self._heap: list[tuple[float, int, int, int, int, tuple[float, float, float]]] = []

    def run(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        for vertex in self._around:
            for other in self._neighbours(vertex):
                if vertex < other:
                    self._push(vertex, other)
        while len(self._around) > count and self._heap:
            _, a, b, version_a, version_b, place = heapq.heappop(self._heap)
            current = self._version.get(a) == version_a and self._version.get(b) == version_b
            if current and self._keeps_topology(a, b):
                self._collapse(a, b, place)
        return self._result()

    def _neighbours(self, vertex: int) -> set[int]:
        return set().union(*(self._faces[face] for face in self._around[vertex])) - {vertex}

    def _push(self, a: int, b: int) -> None:
        quadric = self._quadrics[a] + self._quadrics[b]
        place, cost = _cheapest(quadric, self._points[a], self._points[b])
        heapq.heappush(self._heap, (cost, a, b, self._version[a], self._version[b], place))

    def _keeps_topology(self, a: int, b: int) -> bool:
        """The link condition: nothing but the edge's own triangles joins its ends, and no hole closes."""
        shared = self._around[a] & self._around[b]
        opposite = set().union(*(self._faces[face] for face in shared)) - {a, b} if shared else set()
        if self._neighbours(a) & self._neighbours(b) != opposite or len(self._around) <= 4:
            return False
        return len(shared) == 1 or not (self._at_border(a) and self._at_border(b))

    def _at_border(self, vertex: int) -> bool:
        return len(self._neighbours(vertex)) != len(self._around[vertex])

    def _collapse(self, a: int, b: int, place: tuple[float, float, float]) -> None:
        self._points[a] = place
        self._quadrics[a] = self._quadrics[a] + self._quadrics[b]
        for face in self._around.pop(b):
            if a in self._faces[face]:
                for vertex in self._faces.pop(face) - {b}:
                    self._around[vertex].discard(face)
            else:
                self._faces[face] = (self._faces[face] - {b}) | {a}
                self._order[face] = [a if vertex == b else vertex for vertex in self._order[face]]
                self._around[a].add(face)
        del self._version[b]
        self._version[a] += 1
        for other in self._neighbours(a):
            self._push(*sorted((a, other)))

    def _result(self) -> tuple[np.ndarray, np.ndarray]:
        kept = sorted(self._around)
        number = np.full(len(self._points), -1)
        number[kept] = np.arange(len(kept))
        faces = np.array([self._order[face] for face in sorted(self._faces)], np.int64).reshape(-1, 3)
        return self._points[kept], number[faces]


def _quadrics(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N, 4, 4): of each vertex the sum over its planes (n, d) of area times (n, d)(n, d)ᵀ."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(normal, axis=1)
    normal = normal / np.where(double_area > 0, double_area, 1)[:, None]
    quadrics = np.zeros((len(vertices), 4, 4))
    planes = _planes(normal, corners[:, 0], double_area / 2)
    for corner in range(3):
        np.add.at(quadrics, faces[:, corner], planes)
    start, end, face = _border(faces)
    along = vertices[end] - vertices[start]
    upright = np.cross(
        along, normal[face]
    )  # of the length of the edge, as the face's normal is a unit vector
    length = np.linalg.norm(upright, axis=1)
    upright = upright / np.where(length > 0, length, 1)[:, None]
    borders = _planes(upright, vertices[start], BORDER_WEIGHT * length**2)
    for ends in (start, end):
        np.add.at(quadrics, ends, borders)
    return quadrics


def _planes(normal: np.ndarray, point: np.ndarray, weight: np.ndarray) -> np.ndarray:
    plane = np.concatenate([normal, -(normal * point).sum(1, keepdims=True)], axis=1)
    return weight[:, None, None] * plane[:, :, None] * plane[:, None, :]


def _border(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of one face only: their ends and that face."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, first, times = np.unique(edges, axis=0, return_index=True, return_counts=True)
    single = first[times == 1]
    return edges[single, 0], edges[single, 1], single // 3


def _cheapest(quadric: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """Where an edge's vertex goes, the quadric's minimum or else the best of its ends and middle; and what it costs."""
    matrix, vector = quadric[:3, :3], quadric[:3, 3]
    curvature = np.linalg.eigvalsh(matrix)
    definite = curvature[0] > _SINGULAR * curvature[2]
    places = [-np.linalg.solve(matrix, vector)] if definite else [(a + b) / 2, a, b]
    costs = [float(p @ matrix @ p + 2 * vector @ p + quadric[3, 3]) for p in places]
    best = int(np.argmin(costs))
    x, y, z = places[best].tolist()
    return (x, y, z), max(costs[best], 0.0)
