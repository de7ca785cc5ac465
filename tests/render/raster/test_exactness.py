"""EGL, OSMesa, NumPy and ray casting see the same faces, layer by layer, on meshes good and bad."""

import numpy as np
import pytest

from render import Mesh, frame_cameras, rasterize
from render.raster.screen import before_plane, screen_faces
from tests.helpers.example_meshes import random_soup, sphere, tube, two_quads, two_triangles
from tests.helpers.raster_checks import camera_at, cast_rays, distance_to_edges, peeled

BACKENDS = ("egl", "osmesa", "numpy")
LAYERS = 4
# Hardware snaps corners to 1/256 pixel, so an edge moves by up to √2/512 = 0.003 pixel; three times that.
SNAP_PIXELS = 0.01
# Embree reckons in float32 (2^-24 of lengths of up to 10 m is 0.6 micrometres, in several operations), and trimesh
# goes on from each hit by 10^-6 of the mesh's size, here up to 2 micrometres, or twice that again and again where it
# meets the same face. Surfaces nearer to one another than this may be missed or swapped.
EMBREE_STEP_M = 2e-5


def slivers(count: int = 2000) -> Mesh:
    """The square of two_triangles cut into a strip of triangles far thinner than a pixel."""
    x = np.linspace(-0.5, 0.5, count // 2 + 1)
    vertices = np.concatenate([np.stack([x, 0 * x - 0.5, 0 * x], 1), np.stack([x, 0 * x + 0.5, 0 * x], 1)])
    k, n = np.arange(count // 2), count // 2 + 1
    return Mesh(
        vertices, np.concatenate([np.stack([k, k + 1, k + n], 1), np.stack([k + 1, k + n + 1, k + n], 1)])
    )


def soup_with_trouble(seed: int) -> Mesh:
    """Random faces, and among them faces without area: a corner twice, three corners on a line, one point."""
    soup = random_soup(seed)
    n = len(soup.vertices)
    line = np.array([[-0.5, -0.4, 0.3], [0.1, 0.1, 0.1], [0.7, 0.6, -0.1]])
    bad = np.array([[0, 0, 1], [n, n + 1, n + 2], [5, 5, 5], [n + 2, n, n + 1]])
    faces = np.insert(soup.faces, [10, 50, 90, 120], bad, axis=0)
    return Mesh(np.concatenate([soup.vertices, line]), faces)


def scenes():
    for seed in range(2):
        mesh = soup_with_trouble(seed)
        yield f"soup {seed} from outside", mesh, frame_cameras(mesh, views=["45/20"], size=(96, 128))[0]
        yield f"soup {seed} from amid", mesh, camera_at(0.3, near=0.1)
        yield f"soup {seed}, near plane at 1 mm", mesh, camera_at(0.2, near=1e-3)  # corners at 40,000 pixels
    yield "tube", tube(), frame_cameras(tube(), views=["0/30"], size=(128, 96))[0]
    yield "sphere from inside", sphere(), camera_at(0.1, near=0.05)
    yield "sphere cut by the near plane", sphere(), camera_at(0.4, near=0.2)


SCENES = {name: (mesh, camera) for name, mesh, camera in scenes()}


@pytest.mark.parametrize("name", SCENES)
def test_rasters_agree_with_ray_casting_in_every_layer(name):
    # Seen here and on sixty more scenes of soup: 2.5 million pixels and layers compared, no disagreement.
    mesh, camera = SCENES[name]
    drawn = {
        backend: rasterize(mesh, peeled(camera, LAYERS), backend=backend).face_id for backend in BACKENDS
    }
    np.testing.assert_array_equal(drawn["egl"], drawn["osmesa"])  # the same Mesa: identical fragments
    clear = distance_to_edges(mesh, camera) > SNAP_PIXELS
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(drawn["egl"][:, clear], drawn["numpy"][:, clear])

    cast, depth = cast_rays(mesh, camera, LAYERS)
    exact = rasterize(mesh, peeled(camera, LAYERS + 1), backend="numpy")
    steps = np.diff(exact.depth, axis=0, prepend=np.float32(camera.near))
    apart = ((steps > EMBREE_STEP_M) | ~exact.mask).all(axis=0)
    assert apart.mean() > 0.9
    compared = clear & apart
    np.testing.assert_array_equal(drawn["numpy"][:, compared], cast[:LAYERS, compared])
    assert (drawn["numpy"][:, compared] >= 0).sum() > 5000
    # Depths: Embree's are float32, 2^-24 of lengths of up to 1 m, in a few operations.
    np.testing.assert_allclose(
        exact.depth[0][compared & exact.mask[0]], depth[0][compared & exact.mask[0]], atol=2e-6
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_fragment_is_lost_or_drawn_twice(backend):
    mesh = random_soup(5, n_faces=40)
    (camera,) = frame_cameras(mesh, views="front", size=(48, 64))
    ids = rasterize(mesh, peeled(camera, 40), backend=backend).face_id
    for face in range(40):
        alone = rasterize(Mesh(mesh.vertices, mesh.faces[[face]]), peeled(camera, 2), backend=backend)
        np.testing.assert_array_equal((ids == face).sum(axis=0), alone.mask[0])
        assert not alone.mask[1].any()
    assert (ids >= 0).sum() > 2000


@pytest.mark.parametrize("backend", BACKENDS)
def test_layers_lie_behind_one_another(backend):
    mesh = random_soup(6)
    (camera,) = frame_cameras(mesh, views="front", size=(64, 48))
    raster = rasterize(mesh, peeled(camera, 6), backend=backend)
    assert not (raster.mask[1:] & ~raster.mask[:-1]).any()
    behind = np.diff(raster.depth, axis=0)[raster.mask[1:]]
    # float32 depths of metres: half a unit in the last place each.
    assert behind.min() > -3e-7
    np.testing.assert_array_equal(
        raster.face_id[:2], rasterize(mesh, peeled(camera, 2), backend=backend).face_id
    )
    one = rasterize(mesh, [camera], backend=backend)
    np.testing.assert_array_equal(raster.face_id[:1], one.face_id)
    np.testing.assert_array_equal(raster.barycentric[:1], one.barycentric)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_cut_sheet_has_neither_holes_nor_double_pixels(backend):
    for mesh in (slivers(), two_triangles()):
        (camera,) = frame_cameras(mesh, views="front", size=(64, 80), margin=0.1)
        raster = rasterize(mesh, peeled(camera, 2), backend=backend)
        column = camera.project(np.array([[-0.5, 0, 0], [0.5, 0, 0]]))[:, 0]
        row = camera.project(np.array([[0, 0.5, 0], [0, -0.5, 0]]))[:, 1]
        x, y = np.arange(80) + 0.5, np.arange(64) + 0.5
        expected = ((y > row[0]) & (y < row[1]))[:, None] & ((x > column[0]) & (x < column[1]))
        np.testing.assert_array_equal(raster.mask[0], expected)
        assert not raster.mask[1].any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_side_of_a_face_does_not_matter(backend):
    mesh = random_soup(7)
    turned = Mesh(mesh.vertices, np.where(np.arange(150)[:, None] % 2, mesh.faces[:, ::-1], mesh.faces))
    (camera,) = frame_cameras(mesh, views="front", size=(48, 64))
    both = [rasterize(m, peeled(camera, 3), backend=backend) for m in (mesh, turned)]
    np.testing.assert_array_equal(both[0].face_id, both[1].face_id)
    # A turned face names its corners in another order.
    odd = both[0].face_id % 2 == 1
    np.testing.assert_allclose(both[0].barycentric[odd], both[1].barycentric[odd][:, ::-1], atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_faces_that_lie_on_one_another_are_ordered_by_their_index(backend):
    square = two_triangles()
    heights = np.array([[0, 0, 0.3], [0, 0, -0.1], [0, 0, 0.1], [0, 0, 0.5]])
    copies = [square.faces, square.faces[:, [1, 2, 0]], square.faces[:, ::-1]]
    mesh = Mesh(square.vertices + heights, np.concatenate(copies))
    (camera,) = frame_cameras(mesh, views="20/10", size=(64, 64))
    raster = rasterize(mesh, peeled(camera, 3), backend=backend)
    covered = raster.mask[0]
    assert covered.sum() > 1000
    assert (raster.face_id[:, covered] // 2 == [[0], [1], [2]]).all()
    assert (raster.face_id[:, ~covered] == -1).all()


def test_coplanar_faces_of_other_corners_do_not_flicker():
    # The square cut along its other diagonal lies in the same tilted plane; rounding must not mix the two.
    corners = np.array([[-0.5, -0.5, 0.3], [0.5, -0.5, -0.1], [0.5, 0.5, 0.1], [-0.5, 0.5, 0.5]])
    mesh = Mesh(np.concatenate([corners, corners]), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 7], [5, 6, 7]]))
    (camera,) = frame_cameras(mesh, views="20/10", size=(64, 64))
    raster = rasterize(mesh, peeled(camera, 2), backend="numpy")
    assert set(np.unique(raster.face_id[0])) == {-1, 0, 1}
    assert set(np.unique(raster.face_id[1])) == {-1, 2, 3}


# The near plane


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_face_through_the_near_plane_by_hand(backend):
    # A floor 1 m below the camera that runs from 20 m ahead to 10 m behind. The rays through the four rows' centres
    # fall 3/4, 1/4, -1/4 and -3/4 m a metre: the upper two miss, the others meet the floor at depths 4 and 4/3 m,
    # where the corner behind has the weights (20 - 4) / 30 and (20 - 4/3) / 30.
    mesh = Mesh(np.array([[-10, -1, -20], [10, -1, -20], [0, -1, 10.0]]), np.array([[0, 1, 2]]))
    camera = camera_at(0, near=1, size=(4, 3))
    camera.projection[:2, :2] = np.eye(2)
    raster = rasterize(mesh, [camera], backend=backend)
    np.testing.assert_array_equal(raster.face_id[0, :, 1], [-1, -1, 0, 0])
    np.testing.assert_allclose(raster.depth[0, 2:, 1], [4, 4 / 3], rtol=1e-6)
    for row, behind in ((2, 16 / 30), (3, (20 - 4 / 3) / 30)):
        weights = [(1 - behind) / 2, (1 - behind) / 2, behind]
        np.testing.assert_allclose(raster.barycentric[0, row, 1], weights, atol=1e-12)
    cut = rasterize(mesh, [camera_with_near(camera, 1.5)], backend=backend)
    np.testing.assert_array_equal(cut.face_id[0, :, 1], [-1, -1, 0, -1])


def camera_with_near(camera, near):
    moved = camera_at(0, near=near, size=camera.size)
    moved.projection[:2, :2] = camera.projection[:2, :2]
    return moved


def test_parts_before_a_plane_by_hand():
    corners = np.array(
        [
            [[0, 0, -3], [1, 0, -3], [0, 1, -3]],  # in front
            [[0, 0, -1], [1, 0, 1], [0, 1, 1]],  # behind the plane at depth 2
            [[0, 0, -3], [1, 0, -1], [0, 1, 1]],  # one corner in front: cut at 1/2 and at 1/4
            [[0, 0, -1], [1, 0, -3], [0, 1, -4]],  # two corners in front: cut at 1/2 and at 1/3
        ],
        float,
    )
    ids, parts = before_plane(corners, 2)
    np.testing.assert_array_equal(ids, [0, 2, 3, 3])
    np.testing.assert_array_equal(parts[0], corners[0])
    np.testing.assert_allclose(parts[1], [[0, 0, -3], [0.5, 0, -2], [0, 0.25, -2]], atol=1e-15)
    np.testing.assert_allclose(parts[2], [[1, 0, -3], [0, 1, -4], [0.5, 0, -2]], atol=1e-15)
    np.testing.assert_allclose(parts[3], [[0, 1, -4], [0.5, 0, -2], [0, 1 / 3, -2]], atol=1e-15)


def test_neighbours_are_cut_at_the_very_same_points():
    mesh = random_soup(8)
    seen = mesh.vertices[np.sort(mesh.faces, axis=1)]
    _, parts = before_plane(seen, -0.05)
    points = parts[parts[..., 2] == 0.05]
    assert len(points) > 100
    crossing = set()
    for start, end in mesh.edges:
        a, b = mesh.vertices[start], mesh.vertices[end]
        if (a[2] > 0.05) != (b[2] > 0.05):
            share = (0.05 - a[2]) / (b[2] - a[2])
            crossing.add((a + (b - a) * share)[:2].tobytes())
    assert {point[:2].tobytes() for point in points} <= crossing


@pytest.mark.parametrize("backend", BACKENDS)
def test_sheets_through_the_near_plane_have_neither_holes_nor_double_pixels(backend):
    floor = np.array([[-9, -1, -20], [9, -1, -20], [9, -1, 7], [-9, -1, 7.0]])
    mesh = Mesh(floor, two_triangles().faces)
    raster = rasterize(mesh, peeled(camera_at(0, near=0.1, size=(64, 48)), 2), backend=backend)
    assert raster.mask[0, 40:].all()  # 40 rows down the floor is 4 m wide or less and 2.5 m away
    assert not raster.mask[1].any()


def test_faces_at_and_behind_the_near_plane():
    quads = two_quads(gap=1.0)  # at z = 0 and -1; the camera's near plane lies between, or in the first
    behind = screen_faces(quads, camera_at(0.5, near=1.0))
    np.testing.assert_array_equal(behind.ids, [2, 3])
    touching = screen_faces(quads, camera_at(0.5, near=0.5))
    np.testing.assert_array_equal(touching.ids, [0, 1, 2, 3])
    np.testing.assert_allclose(touching.nearest, [0.5, 0.5, 1.5, 1.5])
