"""Simplified meshes by quadric error metrics."""

import numpy as np
import pytest

from imgtransfer.deformers.anchordef.simplification import simplified
from tests.helpers.synthetic import tube


def _sheet(side: int, fold: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A square of (side + 1)² vertices; beyond x = 0.5 it rises by `fold` a metre."""
    x, y = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1), indexing="ij")
    vertices = np.stack([x, y, fold * np.maximum(x - 0.5, 0)], -1).reshape(-1, 3)
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + side + 1, a + side + 2], -1), np.stack([a, a + side + 2, a + 1], -1)]
    )
    return vertices, faces


def test_a_flat_square_keeps_its_corners():
    vertices, _ = simplified(*_sheet(6), 4)
    assert len(vertices) == 4
    corners = vertices[np.lexsort(vertices.T[::-1])]
    np.testing.assert_allclose(corners, [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]], atol=1e-6)


def test_a_fold_keeps_the_ends_of_its_crease():
    vertices, _ = simplified(*_sheet(6, fold=1.0), 6)
    for end in ([0.5, 0, 0], [0.5, 1, 0]):
        assert np.linalg.norm(vertices - end, axis=1).min() < 1e-6


@pytest.mark.parametrize("count", [100, 30, 12])
def test_a_tube_stays_a_tube(count):
    vertices, faces = simplified(*tube(0.2, 1.0, 12, 16, closed=False), count)
    assert len(vertices) == count
    edges = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    assert edges[1].max() <= 2
    assert len(vertices) - len(edges[0]) + len(faces) == 0  # Euler's characteristic of a tube
    assert set(np.unique(faces)) == set(range(count))
    assert np.abs(np.linalg.norm(vertices[:, [0, 2]], axis=1) - 0.2).max() < 0.1


def test_what_would_change_the_topology_stays():
    tetrahedron = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices, left = simplified(tetrahedron, faces, 2)
    assert len(vertices) == 4
    np.testing.assert_array_equal(left, faces)


def test_faces_without_area_and_vertices_in_no_face():
    vertices, faces = _sheet(4)
    vertices = np.concatenate([vertices, [[9, 9, 9]]])
    faces = np.concatenate([faces, [[0, 1, 1], [0, 0, 0]]])
    left, _ = simplified(vertices, faces, 4)
    assert len(left) == 4
    assert left.max() <= 1 + 1e-6
