import numpy as np
import pytest

from render import Camera, InputError, Mesh, View, frame_cameras, parse_views
from render.framing import choose_elevations
from render.raster.visibility import visible_vertices
from tests.helpers.example_meshes import sphere, tube, two_triangles


def names(spec):
    return [view.name for view in parse_views(spec)]


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("front,back", ["front", "back"]),
        (["front", "back"], ["front", "back"]),
        (" left , 45/20", ["left", "45/20"]),
        (["front", [45, 20], [-45.5, -0.1]], ["front", "45/20", "-45.5/-0.1"]),
        ("0/0,450/0,-180/0,270/0", ["front", "left", "back", "right"]),
        ("0/10,360/20", ["0/10", "0/20"]),
        ("four", ["0/auto", "180/auto", "90/auto", "-90/auto"]),
        ("front,60/auto", ["front", "60/auto"]),
        ("ring:1", ["front"]),
        ("ring:4", ["front", "left", "back", "right"]),
        ("ring:6", ["front", "60/0", "120/0", "back", "-120/0", "-60/0"]),
        (("front", "ring:3"), None),
    ],
)
def test_notation(spec, expected):
    if expected is None:
        with pytest.raises(InputError, match="front is there twice"):
            parse_views(spec)
        return
    assert names(spec) == expected
    assert names(expected) == expected  # a view's name says it all
    assert parse_views(expected) == parse_views(spec)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "found ''"),
        ([], "at least one"),
        ("top", "'top'"),
        ("front,,back", "found ''"),
        ("45", "AZIMUTH/ELEVATION"),
        ("45/", "'45/'"),
        ("45/91", "-90 to 90"),
        ("nan/0", "'nan/0'"),
        ("0/nan", "'0/nan'"),
        ("auto/0", "'auto/0'"),
        ("ring:0", "from 1 to 360"),
        ("ring:2.5", "from 1 to 360"),
        ("ring:", "from 1 to 360"),
        ([45, 20], "pairs"),
        ([[45]], "pair"),
        ([[45, "20"]], "pair"),
        ([[45, 20, 3]], "pair"),
        ("front,0/0", "front is there twice"),
        ("45/20,405/20", "45/20 is there twice"),
    ],
)
def test_what_is_no_view_is_refused(spec, message):
    with pytest.raises(InputError, match=message):
        parse_views(spec)


def test_level_sides_have_exact_axes():
    np.testing.assert_array_equal(View(0).rotation(), np.eye(3))
    np.testing.assert_array_equal(View(180).rotation(), np.diag([-1.0, 1, -1]))
    np.testing.assert_array_equal(View(90).rotation(), [[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_array_equal(View(0, 90).rotation(), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_azimuth_and_elevation_by_hand():
    # 30 degrees to the left and 45 up: sin 30 = 1/2, cos 30 = √3/2, sin 45 = cos 45 = √2/2.
    right, up, backward = View(30, 45).rotation()
    np.testing.assert_allclose(right, [np.sqrt(3) / 2, 0, -1 / 2], atol=1e-15)
    np.testing.assert_allclose(backward, [np.sqrt(2) / 4, np.sqrt(2) / 2, np.sqrt(6) / 4], atol=1e-15)
    np.testing.assert_allclose(up, np.cross(backward, right), atol=1e-15)
    assert up[1] > 0


@pytest.mark.parametrize("view", ["45/20", "-120/-60", "10/90", "0/-90", "ring:5"])
@pytest.mark.parametrize("size", [(64, 64), (48, 96), (96, 48)])
def test_tilted_views_look_at_the_middle_and_fit_it_in(view, size):
    mesh = Mesh(tube().vertices + np.array([3, 1, -2]), tube().faces)
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    for camera in frame_cameras(mesh, views=view, size=size, margin=0.1):
        np.testing.assert_allclose(camera.view[:3, :3] @ camera.view[:3, :3].T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(camera.project(middle)[:2], [size[1] / 2, size[0] / 2], atol=1e-9)
        share = camera.project(mesh.vertices)[:, :2] / (size[1], size[0])
        assert max(0.5 - share.min(), share.max() - 0.5) == pytest.approx(0.4, abs=1e-9)


def test_a_ring_is_the_same_picture_of_a_sphere_from_all_around():
    cameras = frame_cameras(sphere(around=48), views="ring:8")
    distances = [camera.project(np.zeros(3))[2] for camera in cameras]
    np.testing.assert_allclose(distances, distances[0], rtol=1e-6)
    places = np.stack([np.linalg.inv(camera.view)[:3, 3] for camera in cameras])
    angles = np.degrees(np.arctan2(places[:, 0], places[:, 2])) % 360
    np.testing.assert_allclose(angles, np.arange(8) * 45, atol=1e-9)


def test_layers_are_cameras_of_one_place():
    cameras = frame_cameras(two_triangles(), views="front,45/20", layers=3)
    assert [camera.name for camera in cameras] == [
        "front",
        "front/1",
        "front/2",
        "45/20",
        "45/20/1",
        "45/20/2",
    ]
    assert [camera.layer for camera in cameras] == [0, 1, 2, 0, 1, 2]
    np.testing.assert_array_equal(cameras[0].view, cameras[2].view)
    np.testing.assert_array_equal(cameras[0].projection, cameras[2].projection)


@pytest.mark.parametrize("layers", [0, -1, 1.5])
def test_impossible_layers_are_refused(layers):
    with pytest.raises(InputError, match="layers must be"):
        frame_cameras(two_triangles(), layers=layers)
    (camera,) = frame_cameras(two_triangles(), views="front")
    if layers:
        with pytest.raises(InputError, match="layer must be"):
            Camera("deep", camera.view, camera.projection, (8, 8), layer=layers)


def tray() -> Mesh:
    """A horizontal square, finely divided, with a rim 0.2 m high that hides it from all level sides."""
    grid = np.linspace(-0.5, 0.5, 11)
    x, z = np.meshgrid(grid, grid)
    floor = np.stack([x, 0 * x, z], -1).reshape(-1, 3)
    a = (np.arange(10)[:, None] * 11 + np.arange(10)).reshape(-1)
    faces = np.concatenate([np.stack([a, a + 11, a + 1], 1), np.stack([a + 1, a + 11, a + 12], 1)])
    corners = 0.55 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    up = np.array([0, 1, 0])
    rim = np.concatenate([corners - 0.1 * up, corners + 0.1 * up])
    k = np.arange(4)
    walls = np.concatenate(
        [np.stack([k, (k + 1) % 4, k + 4], 1), np.stack([(k + 1) % 4, (k + 1) % 4 + 4, k + 4], 1)]
    )
    return Mesh(np.concatenate([floor, rim]), np.concatenate([faces, walls + len(floor)]))


def test_open_elevations_are_raised_only_where_that_shows_more():
    level = frame_cameras(tube(), views="four")
    # Level views see all of the tube but its fold's depths; none of them needs to be steep.
    assert max(abs(parse_views([camera.name])[0].elevation) for camera in level) <= 10
    tilted = frame_cameras(tray(), views="four")
    seen = [visible_vertices(tray(), camera)[:121].mean() for camera in tilted]
    assert sum(abs(parse_views([camera.name])[0].elevation) >= 20 for camera in tilted) >= 1
    assert max(seen) > 0.5
    assert not np.any([visible_vertices(tray(), c)[:121] for c in frame_cameras(tray(), views="ring:4")])


def test_chosen_elevations_do_not_depend_on_the_image_size_and_name_themselves():
    chosen = [camera.name for camera in frame_cameras(tray(), views="four")]
    assert [camera.name for camera in frame_cameras(tray(), views="four", size=(40, 90))] == chosen
    again = frame_cameras(tray(), views=chosen)
    for camera, same in zip(frame_cameras(tray(), views="four"), again, strict=True):
        np.testing.assert_array_equal(camera.view, same.view)


def test_given_elevations_are_kept():
    views = parse_views("front,90/auto,0/-30")
    chosen = choose_elevations(tube(), views, lambda view: frame_cameras(tube(), views=[view.name])[0])
    assert (chosen[0], chosen[2]) == (views[0], views[2])
    assert chosen[1].azimuth == 90
    assert chosen[1].elevation is not None
    with pytest.raises(ValueError, match="not been chosen"):
        views[1].rotation()
