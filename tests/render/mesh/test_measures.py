import numpy as np
import pytest

from render import Mesh
from render.mesh import area_fractions, edge_lengths, face_areas, volume
from tests.helpers.example_meshes import sphere

# A right triangle with legs of 3 and 4 m, one of 4 and 5 m, and one without area.
POINTS = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 5]])
FACES = np.array([[0, 1, 2], [0, 2, 3], [1, 1, 2]])
TETRAHEDRON = Mesh(POINTS, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def test_edge_lengths_by_hand():
    edges = np.array([[0, 1], [2, 1], [3, 3]])
    assert edge_lengths(POINTS, edges).tolist() == [3, 5, 0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_edge_lengths_of_a_batch_equal_those_of_its_frames(dtype):
    mesh = sphere(around=6, along=5)
    frames = np.random.default_rng(0).normal(size=(2, 3, len(mesh.vertices), 3)).astype(dtype)
    lengths = edge_lengths(frames, mesh.edges)
    assert lengths.dtype == dtype
    for place in np.ndindex(2, 3):
        loop = [np.sqrt(np.square(frames[place][i] - frames[place][j]).sum()) for i, j in mesh.edges]
        np.testing.assert_allclose(lengths[place], loop, rtol=1e-6)


def test_face_areas_by_hand():
    assert face_areas(POINTS, FACES).tolist() == [6, 10, 0]


def test_area_fractions_by_hand():
    # Of 16 m² the first two faces give 2 m² and 10/3 m² to each of their corners; vertex 4 has no face.
    points = np.concatenate([POINTS, np.ones((1, 3))])
    fractions = area_fractions(points, FACES)
    np.testing.assert_allclose(fractions, np.array([2 + 10 / 3, 2, 2 + 10 / 3, 10 / 3, 0]) / 16, rtol=1e-14)


def test_volume_by_hand_wherever_the_mesh_stands():
    assert volume(POINTS, TETRAHEDRON.faces) == pytest.approx(10, rel=1e-14)  # 3 · 4 · 5 / 6
    assert volume(POINTS + np.array([7.0, -3, 2]), TETRAHEDRON.faces) == pytest.approx(10, rel=1e-12)


def test_volume_of_an_inside_out_mesh_is_negative():
    assert volume(POINTS, TETRAHEDRON.faces[:, ::-1]) == pytest.approx(-10, rel=1e-14)


def test_volume_of_a_mesh_with_an_opening_has_its_sign_wherever_it_stands():
    mesh = sphere()
    opened = mesh.faces[mesh.vertices[mesh.faces][:, :, 1].max(axis=1) < 0.25]
    assert len(opened) < len(mesh.faces)
    whole = volume(mesh.vertices, mesh.faces)
    for shift in ([0.0, 0, 0], [0, 50, 0], [0, -50, 0]):
        assert 0.7 * whole < volume(mesh.vertices + shift, opened) < whole


def test_measures_do_not_change_by_rigid_motion():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = POINTS @ turn.T + [1.0, 2, 3]
    np.testing.assert_allclose(face_areas(moved, FACES), face_areas(POINTS, FACES), rtol=1e-12)
    np.testing.assert_allclose(
        edge_lengths(moved, TETRAHEDRON.edges), edge_lengths(POINTS, TETRAHEDRON.edges)
    )
