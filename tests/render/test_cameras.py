import numpy as np
import pytest

from render import Camera, InputError, Mesh, frame_cameras
from tests.helpers.example_meshes import sphere, tube, two_triangles


def test_projection_by_hand():
    # Half field 45 degrees, no margin: the square's half width 0.5 m fits at a distance of 0.5 m.
    (camera,) = frame_cameras(two_triangles(), views=["front"], size=(100, 100), fov_degrees=90, margin=0)
    points = np.array([[0, 0, 0], [0.25, 0.25, 0], [-0.5, 0.5, 0], [0.25, 0, -0.5]])
    expected = [[50, 50, 0.5], [75, 25, 0.5], [0, 0, 0.5], [62.5, 50, 1.0]]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-12)


def test_projection_by_hand_on_a_wide_image():
    # Square pixels: the field over the shorter side (height) is 90 degrees, the width shows twice as much.
    (camera,) = frame_cameras(two_triangles(), views=["front"], size=(100, 200), fov_degrees=90, margin=0)
    np.testing.assert_allclose(camera.project(np.array([0.25, 0.25, 0])), [125, 25, 0.5], atol=1e-12)


@pytest.mark.parametrize(
    ("view", "toward"),
    [("front", (0, 0, 1)), ("back", (0, 0, -1)), ("left", (1, 0, 0)), ("right", (-1, 0, 0))],
)
def test_views_stand_on_their_side_and_keep_up(view, toward):
    (camera,) = frame_cameras(sphere(), views=[view])
    centre, near = camera.project(np.zeros(3)), camera.project(0.3 * np.array(toward))
    assert near[2] == pytest.approx(centre[2] - 0.3)
    np.testing.assert_allclose(centre[:2], [128, 128], atol=1e-9)
    assert camera.project(np.array([0, 0.1, 0]))[1] < centre[1]


@pytest.mark.parametrize(
    ("view", "right_hand_side"),
    [("front", (1, 0, 0)), ("back", (-1, 0, 0)), ("left", (0, 0, -1)), ("right", (0, 0, 1))],
)
def test_what_lies_to_the_right_in_each_view(view, right_hand_side):
    (camera,) = frame_cameras(sphere(), views=[view])
    assert camera.project(0.1 * np.array(right_hand_side))[0] > 128


@pytest.mark.parametrize("size", [(64, 64), (48, 96), (96, 48)])
def test_the_vertices_fit_and_touch_the_margin(size):
    mesh = Mesh(tube().vertices + np.array([3, 1, -2]), tube().faces)
    for camera in frame_cameras(mesh, views=("front", "back", "left", "right"), size=size, margin=0.1):
        share = camera.project(mesh.vertices)[:, :2] / (size[1], size[0])
        assert share.min() >= 0.1 - 1e-9
        assert share.max() <= 0.9 + 1e-9
        assert max(0.5 - share.min(), share.max() - 0.5) == pytest.approx(0.4, abs=1e-9)


def test_a_needle_pointing_at_the_camera_stays_before_the_near_plane():
    mesh = Mesh(np.array([[0, 0, 5], [1e-4, 0, -5], [0, 1e-4, -5.0]]), np.array([[0, 1, 2]]))
    (camera,) = frame_cameras(mesh, views=("front",), size=(32, 32))
    assert camera.project(mesh.vertices)[:, 2].min() > 1.5 * camera.near


def test_points_behind_the_camera_have_no_place():
    (camera,) = frame_cameras(two_triangles(), views=["front"])
    projected = camera.project(np.array([0.0, 0, 100]))
    assert np.isnan(projected[:2]).all()
    assert projected[2] < 0


def test_near_plane_is_read_from_the_projection():
    (camera,) = frame_cameras(two_triangles(), views=["front"], fov_degrees=90, margin=0)
    assert camera.near == pytest.approx(0.5 / 20)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"views": ["top"]}, "top"),
        ({"views": []}, "views"),
        ({"views": ["front", "front"]}, "different"),
        ({"size": (0, 64)}, "size"),
        ({"size": (64.5, 64)}, "size"),
        ({"fov_degrees": 180}, "field of view"),
        ({"margin": 0.5}, "margin"),
    ],
)
def test_unusable_framing_is_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        frame_cameras(two_triangles(), **wrong)


def test_a_mesh_at_one_point_is_refused():
    with pytest.raises(InputError, match="one point"):
        frame_cameras(Mesh(np.ones((3, 3)), np.array([[0, 1, 2]])))


def test_unusable_camera_matrices_are_refused():
    (camera,) = frame_cameras(two_triangles(), views=["front"])
    with pytest.raises(InputError, match="perspective"):
        Camera("flat", camera.view, np.eye(4), (8, 8))
    with pytest.raises(InputError, match="view must be"):
        Camera("short", camera.view[:3], camera.projection, (8, 8))
    with pytest.raises(InputError, match="view must be"):
        Camera("broken", np.full((4, 4), np.nan), camera.projection, (8, 8))
