import numpy as np
import pytest

import render.raster.raster
from render import InputError, Mesh, frame_cameras, rasterize
from render.raster.context import GLUnavailableError
from render.raster.reference import reference_face_ids
from render.raster.screen import screen_faces
from tests.helpers.example_meshes import random_soup, sphere, tube, two_quads, two_triangles
from tests.helpers.raster_checks import distance_to_edges

BACKENDS = ("egl", "osmesa", "numpy")
MESHES = {"tube": tube(), "sphere": sphere(), **{f"random {seed}": random_soup(seed) for seed in range(4)}}


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
@pytest.mark.parametrize("name", MESHES)
def test_face_ids_of_gl_agree_with_the_reference(backend, name):
    mesh = MESHES[name]
    cameras = frame_cameras(mesh, views=("front", "back", "left"), size=(96, 128))
    drawn, reference = rasterize(mesh, cameras, backend=backend), rasterize(mesh, cameras, backend="numpy")
    clear = np.stack([distance_to_edges(mesh, camera) > 0.01 for camera in cameras])
    assert clear.mean() > 0.9
    assert (reference.face_id[clear] >= 0).sum() > 3000
    np.testing.assert_array_equal(drawn.face_id[clear], reference.face_id[clear])


def ray_triangle(origin, direction, corners):
    """Möller and Trumbore 1997: barycentrics and distance along the ray for one triangle."""
    edge_1, edge_2 = corners[1] - corners[0], corners[2] - corners[0]
    p = np.cross(direction, edge_2)
    offset = origin - corners[0]
    q = np.cross(offset, edge_1)
    determinant = edge_1 @ p
    u, v, t = offset @ p / determinant, direction @ q / determinant, edge_2 @ q / determinant
    return np.array([1 - u - v, u, v]), t


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["tube", "random 0"])
def test_barycentrics_and_depth_are_those_of_the_ray_through_the_pixel(backend, name):
    mesh = MESHES[name]
    (camera,) = frame_cameras(mesh, views=["left"], size=(48, 64))
    raster = rasterize(mesh, [camera], backend=backend)
    clear = raster.mask[0] & (distance_to_edges(mesh, camera) > 0.01)
    to_world = np.linalg.inv(camera.view)
    for row, column in np.argwhere(clear):
        device = np.array([(column + 0.5) / 32 - 1, 1 - (row + 0.5) / 24])
        ray = np.array([device[0] / camera.projection[0, 0], device[1] / camera.projection[1, 1], -1.0])
        corners = mesh.vertices[mesh.faces[raster.face_id[0, row, column]]]
        weights, depth = ray_triangle(to_world[:3, 3], to_world[:3, :3] @ ray, corners)
        np.testing.assert_allclose(raster.barycentric[0, row, column], weights, rtol=0, atol=1e-5)
        assert raster.depth[0, row, column] == pytest.approx(depth, abs=1e-5)  # the ray has depth 1 a unit
    assert clear.sum() > 400


@pytest.mark.parametrize("backend", BACKENDS)
def test_barycentrics_are_a_partition_and_zero_in_the_background(backend):
    mesh = MESHES["random 1"]
    raster = rasterize(mesh, frame_cameras(mesh, size=(64, 64)), backend=backend)
    assert (raster.barycentric >= 0).all()
    np.testing.assert_allclose(raster.barycentric.sum(-1), raster.mask, atol=1e-12)
    assert (raster.depth[~raster.mask] == 0).all()
    assert raster.backend == backend


def test_centres_on_the_shared_edge_belong_to_exactly_one_face():
    # The square fills the image and its diagonal runs through pixel centres.
    (camera,) = frame_cameras(two_triangles(), views=["front"], size=(16, 16), fov_degrees=90, margin=0)
    both = reference_face_ids(screen_faces(two_triangles(), camera), camera.size)[0]
    alone = [
        reference_face_ids(
            screen_faces(Mesh(two_triangles().vertices, two_triangles().faces[[f]]), camera), (16, 16)
        )
        for f in range(2)
    ]
    assert (both >= 0).all()
    assert ((alone[0] >= 0) ^ (alone[1] >= 0)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_row_zero_is_the_top_and_both_sides_are_drawn(backend):
    vertices = np.array([[-0.5, 0.1, 0], [0.5, 0.1, 0], [0, 0.5, 0], [0, -0.5, 0]])
    for order in ([0, 1, 2], [0, 2, 1]):
        mesh = Mesh(vertices, np.array([order]))
        raster = rasterize(mesh, frame_cameras(mesh, size=(32, 32)), backend=backend)
        assert raster.mask[:, :16].sum() > 100
        assert raster.mask[:, 17:].sum() == 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_nearer_face_wins_whatever_the_order(backend):
    front = two_quads()
    turned = Mesh(front.vertices, front.faces[::-1])
    for mesh, nearer in ((front, {0, 1}), (turned, {2, 3})):
        raster = rasterize(mesh, frame_cameras(mesh, views=["front"], size=(40, 40)), backend=backend)
        assert set(np.unique(raster.face_id)) == {-1} | nearer
        # The rear square is smaller and hidden in front, but seen from the back.
        back = rasterize(mesh, frame_cameras(mesh, views=["back"], size=(40, 40)), backend=backend)
        assert set(np.unique(back.face_id)) == {-1, 0, 1, 2, 3}


@pytest.mark.parametrize("backend", BACKENDS)
def test_of_two_faces_at_one_place_the_first_wins(backend):
    mesh = Mesh(two_triangles().vertices, np.concatenate([two_triangles().faces] * 2))
    raster = rasterize(mesh, frame_cameras(mesh, size=(32, 32)), backend=backend)
    assert set(np.unique(raster.face_id)) == {-1, 0, 1}


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_garment_outside_the_view_is_refused(backend):
    cameras = frame_cameras(two_triangles(), size=(16, 16))
    for offset in ([5, 0, 0], [0, 0, 50]):  # beside the image; behind the front camera
        moved = Mesh(two_triangles().vertices + offset, two_triangles().faces, source="shirt.obj")
        with pytest.raises(InputError, match=r"shirt\.obj: garment outside the view: camera 'front'"):
            rasterize(moved, cameras, backend=backend)


def test_cameras_of_different_sizes_are_refused():
    cameras = frame_cameras(tube(), size=(16, 16))[:1] + frame_cameras(tube(), size=(16, 32))[1:]
    with pytest.raises(InputError, match="one size"):
        rasterize(tube(), cameras)
    with pytest.raises(InputError, match="one or more cameras"):
        rasterize(tube(), [])


def test_an_unknown_backend_is_refused():
    with pytest.raises(InputError, match="vulkan"):
        rasterize(tube(), frame_cameras(tube()), backend="vulkan")


def test_without_gl_the_reference_draws_and_says_what_to_install(monkeypatch):
    def none_there(backend):
        raise GLUnavailableError(f"{backend}: not installed")

    monkeypatch.setattr(render.raster.raster, "open_context", none_there)
    cameras = frame_cameras(tube(), size=(32, 32))
    with pytest.warns(UserWarning, match="apt-get install libegl1 libgl1-mesa-dri"):
        raster = rasterize(tube(), cameras)
    assert raster.backend == "numpy"
    np.testing.assert_array_equal(raster.face_id, rasterize(tube(), cameras, backend="numpy").face_id)
    with pytest.raises(InputError, match="apt-get install libosmesa6"):
        rasterize(tube(), cameras, backend="osmesa")


@pytest.mark.osmesa
def test_auto_takes_the_first_that_works(monkeypatch):
    real = render.raster.raster.open_context

    def no_egl(backend):
        if backend == "egl":
            raise GLUnavailableError("egl: not installed")
        return real(backend)

    cameras = frame_cameras(tube(), size=(32, 32))
    assert rasterize(tube(), cameras).backend == "egl"
    monkeypatch.setattr(render.raster.raster, "open_context", no_egl)
    assert rasterize(tube(), cameras).backend == "osmesa"
