import numpy as np
import pytest
from example_meshes import sphere, tube, two_quads

from render import Mesh, TemplateImager, frame_cameras
from render.visibility import visible_vertices


def test_the_rear_quad_is_hidden_from_the_front_only():
    mesh = two_quads()
    front, back = frame_cameras(mesh, size=(40, 40))
    np.testing.assert_array_equal(visible_vertices(mesh, front), [True] * 4 + [False] * 4)
    np.testing.assert_array_equal(visible_vertices(mesh, back), [True] * 8)


@pytest.mark.parametrize("gap", [1e-4, 0.01, 1.0])
def test_hiding_does_not_depend_on_the_gap(gap):
    mesh = two_quads(gap)
    (front,) = frame_cameras(mesh, views=["front"], size=(40, 40))
    np.testing.assert_array_equal(visible_vertices(mesh, front), [True] * 4 + [False] * 4)


def test_of_a_sphere_the_cap_up_to_the_tangent_cone_is_seen():
    # From distance d the sphere of radius r is seen where z >= r² / d (the tangent points' height).
    mesh = sphere(around=64, along=33)
    (front,) = frame_cameras(mesh, views=["front"])
    distance = front.project(np.zeros(3))[2]
    above_horizon = mesh.vertices[:, 2] - 0.3**2 / distance
    seen = visible_vertices(mesh, front)
    edge = 0.03  # a facet's width: the polyhedron's horizon is its facets'
    assert seen[above_horizon > edge].all()
    assert not seen[above_horizon < -edge].any()
    assert 0.3 < seen.mean() < 0.5


def test_a_vertex_outside_the_image_is_not_seen():
    mesh = two_quads()
    cameras = frame_cameras(mesh, views=["front"], size=(40, 40))
    vertices = mesh.vertices.copy()
    vertices[1, 0] = 5.0
    np.testing.assert_array_equal(visible_vertices(Mesh(vertices, mesh.faces), cameras[0])[:2], [True, False])


def test_plain_loop_agrees():
    mesh = tube(16, 10)
    (camera,) = frame_cameras(mesh, views=["left"], size=(32, 48))
    eye = np.linalg.inv(camera.view)[:3, 3]
    expected = np.ones(len(mesh.vertices), bool)
    for vertex, point in enumerate(mesh.vertices):
        for face in mesh.faces:
            if vertex in face:
                continue
            a, b, c = mesh.vertices[face]
            system = np.stack(
                [point - eye, a - b, a - c], axis=1
            )  # eye + t (point - eye) = a + u (b-a) + v (c-a)
            if abs(np.linalg.det(system)) < 1e-14:
                continue
            t, u, v = np.linalg.solve(system, a - eye)
            expected[vertex] &= not (u >= 0 and v >= 0 and u + v <= 1 and 0 < t < 1 - 1e-6)
    seen = visible_vertices(mesh, camera)
    assert 0.2 < expected.mean() < 0.8
    np.testing.assert_array_equal(seen, expected)


def test_more_views_see_more_of_a_garment():
    mesh = tube()
    two = TemplateImager.build(mesh, size=(128, 128)).visible
    four = TemplateImager.build(mesh, size=(128, 128), views=("front", "back", "left", "right")).visible
    np.testing.assert_array_equal(two, four[:2])
    assert 0.85 < two.any(axis=0).mean() < four.any(axis=0).mean()
    assert four.any(axis=0).mean() > 0.99
