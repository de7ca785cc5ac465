"""Which vertices of one layer of cloth lie against which of another: linings, pockets, pieces sewn together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh
from render.mesh.normals import vertex_normals

_REACH = 0.02  # metres: layers farther apart than this move on their own
_PARALLEL = 0.7  # |cos| of the angle between the normals of vertices that lie against each other, at least
_ACROSS = 0.5  # cos of the angle between a layer's normal and the line to the vertex against it, at least
_TOUCHING = 1e-6  # metres: vertices as near as this are one, whatever their normals say
_DETOUR = 2.5  # layers of one piece: the way along the cloth is longer than the straight one by this factor at least
_MOST = 3  # links of a vertex
_FIRM = 4.0  # stiffness of a vertex's links together, as a multiple of an edge's: layers keep their distance
_SHORTEST = 0.1  # of the mean edge: shorter links get no stiffer
_AT_ONCE = 2000  # vertices whose neighbourhoods are in memory together


@dataclass(frozen=True, eq=False)
class Links:
    """Pairs of vertices that keep their offset from each other but for a rotation, as the ends of an edge do.

    Args:
        pairs: (K, 2) int64.
        stiffness: (K,) 1 for a link as long as the mesh's mean edge, more for a shorter one.
    """

    pairs: np.ndarray
    stiffness: np.ndarray

    @classmethod
    def edges_of(cls, mesh: Mesh) -> Links:
        """All edges."""
        return _links(mesh, mesh.edges)

    def __add__(self, other: Links) -> Links:
        return Links(
            np.concatenate([self.pairs, other.pairs]), np.concatenate([self.stiffness, other.stiffness])
        )

    def moved(self, count: int) -> Links:
        """Between vertices whose numbers are higher by `count`."""
        return Links(self.pairs + count, self.stiffness)


def _links(mesh: Mesh, pairs: np.ndarray) -> Links:
    """As stiff as 1 / length."""
    mean = edge_lengths(mesh.vertices, mesh.edges).mean()
    shortest = max(_SHORTEST * mean, np.finfo(np.float32).tiny)
    return Links(pairs, mean / edge_lengths(mesh.vertices, pairs).clip(min=shortest))


def links_to_layers(mesh: Mesh, piece: np.ndarray, asked: np.ndarray) -> Links:
    """From vertices to those of other layers that they lie against: above or below along the normal, within 2 cm.

    Layers of one piece face the same way, as a pocket's bag and the cloth that it is sewn to do: where a piece faces
    itself, as at an armpit, its sides go apart when it moves. A layer that is a piece of its own may face the other way
    if both have their backs to each other, as a lining may.

    Args:
        mesh: at rest, N vertices.
        piece: (N,) the number of the connected piece that each vertex belongs to.
        asked: (N,) bool, the vertices that links are wanted for.

    Returns:
        Three links at most from each of them, to the nearest.
    """
    numbers = np.flatnonzero(asked)
    tree = cKDTree(mesh.vertices)
    normals = vertex_normals(torch.from_numpy(mesh.vertices), torch.from_numpy(mesh.faces)).numpy()
    lengths = edge_lengths(mesh.vertices, mesh.edges).clip(min=_TOUCHING)  # 0 would be no edge
    along = scipy.sparse.csr_matrix((lengths, mesh.edges.T), shape=(len(normals),) * 2)
    parts = [np.zeros((0, 2), np.int64)]
    for start in range(0, len(numbers), _AT_ONCE):
        first, second, distance = _near(mesh.vertices, tree, numbers[start : start + _AT_ONCE], _REACH)
        offset = mesh.vertices[second] - mesh.vertices[first]
        ahead = (offset * normals[first]).sum(1)
        cosine = (normals[first] * normals[second]).sum(1)
        other = piece[first] != piece[second]
        facing = (cosine >= _PARALLEL) | (other & (cosine <= -_PARALLEL) & (ahead < 0))
        kept = facing & (np.abs(ahead) >= _ACROSS * distance) & (distance > _TOUCHING)
        kept[kept] = other[kept] | _far_along(along, first[kept], second[kept], _DETOUR * distance[kept])
        parts.append(_nearest_of_each(first[kept], second[kept], distance[kept]))
    return _evenly(mesh, np.concatenate(parts))


def _far_along(
    along: scipy.sparse.csr_matrix, first: np.ndarray, second: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """(K,) bool, whether the way along the edges from `first` to `second` is longer than a distance each, in metres."""
    if not len(first):
        return np.zeros(0, bool)
    sources, row = np.unique(first, return_inverse=True)
    ways = dijkstra(along, directed=False, indices=sources, limit=_DETOUR * _REACH)
    far: np.ndarray = ways[row, second] > distance
    return far


def links_across_seams(mesh: Mesh, piece: np.ndarray, asked: np.ndarray) -> Links:
    """From vertices to those of other pieces at the same place, where the mesh keeps a seam open; else as above."""
    numbers = np.flatnonzero(asked)
    first, second, distance = _near(mesh.vertices, cKDTree(mesh.vertices), numbers, _TOUCHING)
    other = piece[first] != piece[second]
    return _evenly(mesh, _nearest_of_each(first[other], second[other], distance[other]))


def _near(
    points: np.ndarray, tree: cKDTree, numbers: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points `numbers` and which of the tree are within reach of each other: both (K,), and their distances."""
    near = cKDTree(points[numbers]).sparse_distance_matrix(tree, reach, output_type="ndarray")
    return numbers[near["i"]], near["j"], near["v"]


def _nearest_of_each(first: np.ndarray, second: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(L, 2) the three nearest `second` of each `first`."""
    order = np.lexsort((second, distance, first))
    pairs = np.stack([first, second], axis=1)[order]
    rank = np.arange(len(pairs)) - np.searchsorted(pairs[:, 0], pairs[:, 0])
    return pairs[rank < _MOST]


def links_to_pieces(mesh: Mesh, piece: np.ndarray, known: np.ndarray) -> Links:
    """From every vertex of pieces of which nothing is known to the nearest ones of other pieces.

    Args:
        mesh: at rest, N vertices.
        piece: (N,) the number of the connected piece that each vertex belongs to.
        known: (pieces,) bool, one at least.

    Returns:
        Three links at most a vertex.
    """
    lost = np.flatnonzero(~known[piece])
    if not len(lost):
        return _evenly(mesh, np.zeros((0, 2), np.int64))
    others = np.flatnonzero(known[piece])
    count = min(_MOST, len(others))
    _, nearest = cKDTree(mesh.vertices[others]).query(mesh.vertices[lost], k=count)
    pairs = np.stack([np.repeat(lost, count), others[np.asarray(nearest).ravel()]], axis=1)
    return _evenly(mesh, pairs)


def _evenly(mesh: Mesh, pairs: np.ndarray) -> Links:
    """Links from pairs[:, 0]: those of one vertex are together several times as stiff as an edge."""
    count = np.bincount(pairs[:, 0], minlength=1)
    links = _links(mesh, pairs.astype(np.int64))
    return Links(links.pairs, _FIRM * links.stiffness / count[pairs[:, 0]])
