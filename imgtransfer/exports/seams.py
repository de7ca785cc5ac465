"""Texture coordinates for glTF, which wants one a vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from render.mesh.surface import Surface


@dataclass(frozen=True, eq=False)
class Seamed:
    """A mesh cut at its texture seams.

    Args:
        vertices: (K,) the template's vertex behind each vertex; the file's own come first, in its order.
        faces: (F, 3) int64.
        uvs: (K, 2) float32 with v downwards, as glTF has it; None where there are none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uvs: np.ndarray | None


def cut_at_seams(surface: Surface) -> Seamed:
    """Give every vertex one texture coordinate: further ones get copies of the vertex behind all others."""
    if surface.uvs is None or surface.uv_faces is None:
        return Seamed(surface.vertices, surface.faces, None)
    corners = np.stack([surface.faces.reshape(-1), surface.uv_faces.reshape(-1)], axis=1)
    pairs, pair_of_corner = np.unique(corners, axis=0, return_inverse=True)
    count = len(surface.vertices)
    first = np.ones(len(pairs), bool)  # of the vertex; pairs are sorted by it
    first[1:] = pairs[1:, 0] != pairs[:-1, 0]
    place = np.where(first, pairs[:, 0], count + np.cumsum(~first) - 1)
    vertices = np.concatenate([np.arange(count), pairs[~first, 0]])
    uvs = np.zeros((len(vertices), 2), np.float32)
    with_uv = pairs[:, 1] >= 0
    uvs[place[with_uv]] = surface.uvs[pairs[with_uv, 1]] * np.array([1, -1], np.float32) + np.array(
        [0, 1], np.float32
    )
    return Seamed(surface.vertices[vertices], place[pair_of_corner.reshape(-1)].reshape(-1, 3), uvs)
