"""How much of a garment passes through a body, and through itself: crossing edges, of all that the garment has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fusion.obstacles.crossings import edges_through_faces, edges_through_own_faces
from render.mesh.mesh import edges_of


def body_crossing_fractions(
    vertices: np.ndarray, faces: np.ndarray, body_vertices: np.ndarray, body_faces: np.ndarray
) -> NDArray[np.float64]:
    """Garment edges that pass through faces of the body plus body edges that pass through faces of the garment.

    Args:
        vertices: (T, N, 3) metres, of the garment; it may be open.
        faces: (F, 3) integers.
        body_vertices: (T, B, 3) metres.
        body_faces: (G, 3) integers.

    Returns:
        (T,) float64, over the number of the garment's edges: 0 where nothing passes through, above 1 where more of the
        body's edges do than the garment has.
    """
    edges = edges_of(faces)
    of_garment = edges_through_faces(vertices, edges, body_vertices, body_faces)
    of_body = edges_through_faces(body_vertices, edges_of(body_faces), vertices, faces, name="garment")
    return (of_garment.counts() + of_body.counts()).numpy() / len(edges)


def self_crossing_fractions(vertices: np.ndarray, faces: np.ndarray) -> NDArray[np.float64]:
    """Garment edges that pass through faces of the garment that they share no vertex with.

    Args:
        vertices: (T, N, 3) metres.
        faces: (F, 3) integers.

    Returns:
        (T,) float64 in [0, 1], of the garment's edges.
    """
    edges = edges_of(faces)
    return edges_through_own_faces(vertices, edges, faces).counts().numpy() / len(edges)
