"""Meshes that the tests of this folder share; all in metres, facing +z."""

from __future__ import annotations

import numpy as np

from render import Mesh


def two_triangles() -> Mesh:
    """The unit square around the origin at z = 0, cut from its lower left to its upper right corner."""
    vertices = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))


def two_quads(gap: float = 0.2) -> Mesh:
    """A unit square at z = 0 (vertices 0 to 3) and another of half its size behind it, at z = -gap (4 to 7)."""
    square = two_triangles()
    behind = square.vertices * 0.5 - [0, 0, gap]
    return Mesh(np.concatenate([square.vertices, behind]), np.concatenate([square.faces, square.faces + 4]))


def tube(around: int = 60, along: int = 40) -> Mesh:
    """An open tube of a T-shirt's size with folds: about 0.5 m wide, 0.6 m high, 0.25 m deep."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    height = np.linspace(-0.3, 0.3, along)
    phi, y = np.meshgrid(angle, height)
    fold = 1 + 0.06 * np.sin(9 * phi + 4 * y) + 0.1 * y
    vertices = np.stack([0.25 * fold * np.sin(phi), y, 0.125 * fold * np.cos(phi)], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = row * around + column, row * around + (column + 1) % around
    faces = np.stack([np.stack([a, b, b + around], -1), np.stack([a, b + around, a + around], -1)], axis=2)
    return Mesh(vertices, faces.reshape(-1, 3))


def sphere(radius: float = 0.3, around: int = 48, along: int = 25) -> Mesh:
    """A closed sphere around the origin with one vertex at each pole."""
    theta = np.linspace(0, np.pi, along)[1:-1]
    phi = np.linspace(0, 2 * np.pi, around, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    rings = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], axis=-1).reshape(-1, 3)
    vertices = radius * np.concatenate([rings, [[0, 1, 0], [0, -1, 0]]])
    faces = []
    for column in range(around):
        following = (column + 1) % around
        faces.append([len(rings), column, following])
        for row in range(along - 3):
            a, b = row * around + column, row * around + following
            faces += [[a, a + around, b + around], [a, b + around, b]]
        last = (along - 3) * around
        faces.append([len(rings) + 1, last + following, last + column])
    return Mesh(vertices, np.array(faces))


def random_soup(seed: int, n_vertices: int = 120, n_faces: int = 150) -> Mesh:
    """Random triangles through one another, slivers and edge-on faces included."""
    generator = np.random.default_rng(seed)
    vertices = generator.normal(scale=0.3, size=(n_vertices, 3))
    faces = np.stack([generator.choice(n_vertices, 3, replace=False) for _ in range(n_faces)])
    return Mesh(vertices, faces)
