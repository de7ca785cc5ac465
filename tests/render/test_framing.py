"""Cameras as near as a template allows."""

import numpy as np
import pytest

from render import InputError, Mesh
from render.framing import choose_elevations, frame_cameras
from render.views import View
from tests.helpers.example_meshes import two_triangles

SQUARE = two_triangles()


def test_distance_to_a_unit_square_by_hand():
    """At 90 degrees a square of 1 m fills the image from half a metre away; a margin of 0.25 doubles that."""
    for margin, want in ((0.0, 0.5), (0.25, 1.0)):
        (camera,) = frame_cameras(SQUARE, views="front", size=(64, 64), fov_degrees=90, margin=margin)
        np.testing.assert_allclose(camera.view[:3, 3], [0, 0, -want], atol=1e-12)


@pytest.mark.parametrize("size", [(30, 60), (60, 30)])
def test_the_field_of_view_is_that_of_the_shorter_side(size):
    (camera,) = frame_cameras(SQUARE, views="front", size=size, fov_degrees=90)
    height, width = size
    np.testing.assert_allclose(camera.projection[0, 0], min(size) / width)
    np.testing.assert_allclose(camera.projection[1, 1], min(size) / height)


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_in_another_unit_or_place_the_picture_is_the_same(scale):
    mesh = Mesh(np.random.default_rng(0).normal(size=(9, 3)), np.arange(9).reshape(3, 3))
    moved = Mesh(scale * (mesh.vertices + np.array([3.0, -1, 2])), mesh.faces)
    pairs = zip(*(frame_cameras(m, views="front,30/20,left") for m in (mesh, moved)), strict=True)
    for camera, other in pairs:
        want, found = camera.project(mesh.vertices), other.project(moved.vertices)
        np.testing.assert_allclose(found[:, :2], want[:, :2], atol=1e-6)
        np.testing.assert_allclose(found[:, 2], scale * want[:, 2])


def test_all_vertices_lie_between_the_planes_even_of_a_needle_at_the_camera():
    needle = Mesh(np.array([[0.0, 0, -1], [0, 1e-3, -1], [0, 0, 1]]), np.array([[0, 1, 2]]))
    for camera in frame_cameras(needle, views="front,back"):
        depth = camera.project(needle.vertices)[:, 2]
        assert depth.min() > 0.05
        assert depth.min() > camera.near


def test_the_mirror_image_is_seen_from_the_mirrored_side():
    mesh = Mesh(np.random.default_rng(1).normal(size=(6, 3)), np.arange(6).reshape(2, 3))
    mirrored = Mesh(mesh.vertices * [-1, 1, 1], mesh.faces)
    (left,), (right,) = frame_cameras(mesh, views="left"), frame_cameras(mirrored, views="right")
    want, found = left.project(mesh.vertices), right.project(mirrored.vertices)
    np.testing.assert_allclose(found[:, 0], left.size[1] - want[:, 0], atol=1e-9)
    np.testing.assert_allclose(found[:, 1:], want[:, 1:], atol=1e-9)


@pytest.mark.parametrize(
    "options",
    [{"fov_degrees": 0.5}, {"fov_degrees": 121}, {"margin": 0.5}, {"margin": -0.1}, {"margin": np.nan}],
)
def test_what_makes_no_image_is_refused(options):
    with pytest.raises(
        InputError, match=r"field of view must be 1 to 120 degrees and the margin 0 to below 0\.5"
    ):
        frame_cameras(SQUARE, **options)


def test_a_template_in_one_point_is_refused():
    with pytest.raises(InputError, match=r"dot\.obj: all vertices are at one point"):
        frame_cameras(Mesh(np.ones((3, 3)), SQUARE.faces[:1], source="dot.obj"))


def test_without_open_elevations_nothing_is_looked_at():
    def never(view):
        raise AssertionError(view)

    views = (View(0.0, 10.0), View(90.0, -20.0))
    assert choose_elevations(SQUARE, views, never) == views
