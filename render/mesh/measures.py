"""Lengths, areas and volumes of triangle meshes, in the unit of their vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def edge_lengths(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Lengths of edges.

    Args:
        points: (..., N, 3) floating point.
        edges: (E, 2) integer, as `Mesh.edges`.

    Returns:
        (..., E), dtype of `points`.
    """
    lengths: np.ndarray = np.linalg.norm(points[..., edges[:, 1], :] - points[..., edges[:, 0], :], axis=-1)
    return lengths


def face_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Areas of triangles.

    Args:
        points: (N, 3) floating point.
        faces: (F, 3) integer.

    Returns:
        (F,), dtype of `points`; exactly 0 where two corners are one vertex.
    """
    corners = points[faces]
    sides = corners[:, 1:] - corners[:, :1]
    areas: np.ndarray = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    return areas


def area_fractions(points: np.ndarray, faces: np.ndarray) -> NDArray[np.float64]:
    """What fraction of a mesh's area belongs to each vertex: a third of every face around it.

    Args:
        points: (N, 3) floating point, with a face that has an area.
        faces: (F, 3) integer.

    Returns:
        (N,) float64 of sum 1; 0 at vertices that no face uses.
    """
    sums = np.zeros(len(points))
    np.add.at(sums, faces, face_areas(points, faces)[:, None])
    fractions: NDArray[np.float64] = sums / sums.sum()
    return fractions


def volume(points: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume that faces enclose: positive where they are counter-clockwise seen from outside.

    Measured from the vertices' mean, so that openings, such as a neck, take little away.

    Args:
        points: (N, 3) floating point.
        faces: (F, 3) integer.
    """
    a, b, c = np.moveaxis((points - points.mean(axis=0))[faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)
