"""Which pixel centres a face covers, edges and corners included, and the parts that are looked at together."""

import numpy as np
import pytest

from render import Camera, Mesh
from render.cameras import perspective
from render.raster import reference
from render.raster.reference import _chunks, covers, reference_face_ids
from render.raster.screen import screen_faces
from tests.helpers.example_meshes import random_soup

CAMERA = Camera("front", np.eye(4), perspective(np.array([1.5, 1.0]), near=0.1, far=100.0), (20, 30))


def test_inside_and_outside_by_hand():
    triangle = np.array([[0.0, 0], [4, 0], [0, 4]])
    points = np.array([[1.0, 1], [3, 3], [-1, 1], [1, -1], [1.9, 1.9], [2.1, 2.1]])
    for corners in (triangle, triangle[::-1]):
        found = covers(np.repeat(corners[None], len(points), axis=0), points)
        assert found.tolist() == [True, False, False, False, True, False]


def fan(corners):
    """Triangles (K, 3, 2) from the middle of a polygon to its sides."""
    middle = corners.mean(axis=0)
    return np.stack([[middle, a, b] for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("way", [1, -1])
def test_points_on_edges_and_on_the_corner_of_a_fan_belong_to_one_face_each(turn, way):
    """The square's middle, where four faces meet, and points on the edges between two: each is covered once."""
    square = np.array([[0.0, 0], [8, 0], [8, 8], [0, 8]])
    faces = np.roll(fan(square), turn, axis=0)[:, ::way]
    points = np.array([[4.0, 4], [2, 2], [6, 6], [6, 2], [1, 7], [3, 4], [4, 3]])
    counts = sum(covers(np.repeat(face[None], len(points), axis=0), points).astype(int) for face in faces)
    assert counts.tolist() == [1] * len(points)


def test_a_triangle_without_area_covers_nothing():
    line = np.array([[[0.0, 0], [2, 2], [4, 4]]])
    for point in ([1.0, 1.5], [1.0, 0.5], [1.0, 1.0], [2.0, 2.0], [9.0, 9.0]):
        assert not covers(line, np.array([point])).any()


@pytest.mark.parametrize("layers", [1, 3])
def test_the_nearest_faces_are_those_of_a_loop_over_all_pixels(layers):
    mesh = Mesh(random_soup(1, 30, 25).vertices - [0, 0, 1.5], random_soup(1, 30, 25).faces)
    faces = screen_faces(mesh, CAMERA)
    found = reference_face_ids(faces, CAMERA.size, layers)
    every = np.arange(len(faces.ids))
    for row in range(20):
        for column in range(30):
            centre = np.array([column + 0.5, row + 0.5])
            hit = every[covers(faces.corners, np.repeat(centre[None], len(every), axis=0))]
            depth = 1 / faces.reciprocal_depth(hit, centre[None])
            want = faces.ids[hit[np.argsort(depth, kind="stable")]][:layers].tolist()
            assert found[:, row, column].tolist() == want + [-1] * (layers - len(want))


def test_faces_beyond_the_image_draw_only_what_is_in_it():
    huge = Mesh(np.array([[-500.0, -500, -1], [500, -500, -1], [0, 900, -1]]), np.array([[0, 1, 2]]))
    assert (reference_face_ids(screen_faces(huge, CAMERA), CAMERA.size) == 0).all()
    aside = Mesh(huge.vertices + np.array([2000.0, 0, 0]), huge.faces)
    assert (reference_face_ids(screen_faces(aside, CAMERA), CAMERA.size) == -1).all()


def test_parts_hold_every_item_once_and_are_no_larger_than_allowed(monkeypatch):
    monkeypatch.setattr(reference, "_CHUNK", 10)
    counts = np.array([3, 4, 5, 0, 25, 1, 0, 9, 2])
    parts = _chunks(counts)
    assert [k for part in parts for k in range(part.start, part.stop)] == list(range(len(counts)))
    assert len(parts) > 2
    assert all(counts[part][1:].sum() < 10 for part in parts)  # beside one that may be large
    assert _chunks(counts[:0]) == []


def test_drawing_in_parts_is_drawing_at_once(monkeypatch):
    mesh = Mesh(random_soup(2).vertices - [0, 0, 2], random_soup(2).faces)
    faces = screen_faces(mesh, CAMERA)
    want = reference_face_ids(faces, CAMERA.size, 2)
    monkeypatch.setattr(reference, "_CHUNK", 50)
    np.testing.assert_array_equal(reference_face_ids(faces, CAMERA.size, 2), want)
