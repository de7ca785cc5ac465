import numpy as np
import pytest
import torch

from render import Mesh, TemplateImager, frame_cameras
from render.raster.visibility import visible_vertices
from tests.helpers.example_meshes import random_soup, sphere, tube, two_quads, two_triangles
from tests.helpers.raster_checks import peeled


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


@pytest.mark.parametrize("mesh", [tube(16, 10), random_soup(3, 60, 50)], ids=["tube", "soup"])
def test_plain_loop_agrees_in_every_layer(mesh):
    (camera,) = frame_cameras(mesh, views=["50/7"], size=(32, 48))
    eye = np.linalg.inv(camera.view)[:3, 3]
    hiding = np.zeros(len(mesh.vertices), int)
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
            hiding[vertex] += u >= 0 and v >= 0 and u + v <= 1 and 0 < t < 1 - 1e-6
    assert hiding.max() >= 1
    for layered in peeled(camera, hiding.max() + 2):
        np.testing.assert_array_equal(visible_vertices(mesh, layered), hiding == layered.layer)


def test_a_vertex_behind_an_edge_is_behind_one_surface():
    # The rear square's corners and its middle lie behind the front square's diagonal, two of whose faces meet there.
    square = two_triangles()
    behind = np.array([[-0.3, -0.3, -0.2], [0, 0, -0.2], [0.3, 0.3, -0.2], [0.3, -0.3, -0.2]])
    mesh = Mesh(
        np.concatenate([square.vertices, behind]), np.concatenate([square.faces, [[4, 5, 7], [5, 6, 7]]])
    )
    (front,) = frame_cameras(mesh, views="front", size=(64, 64))
    for layer, camera in enumerate(peeled(front, 3)):
        seen = visible_vertices(mesh, camera)
        np.testing.assert_array_equal(seen, [layer == 0] * 4 + [layer == 1] * 4)


def test_layers_partition_the_vertices():
    mesh = random_soup(4)
    (camera,) = frame_cameras(mesh, views="20/30", size=(64, 64))
    seen = np.stack([visible_vertices(mesh, layered) for layered in peeled(camera, 60)])
    np.testing.assert_array_equal(seen.sum(axis=0), 1)
    assert seen.any(axis=1).sum() > 10


@pytest.mark.parametrize("views", ["front,back", "four"])
def test_values_are_read_from_a_layer_as_well_as_from_the_nearest(views):
    mesh = tube()
    imager = TemplateImager.build(mesh, views=views, layers=2, size=(192, 160))
    vertices = torch.from_numpy(mesh.vertices)
    bent = vertices + 0.05 * torch.sin(4 * vertices[:, [1, 2, 0]])  # a smooth deformation, 5 cm
    error = (imager.sample(imager.operator(bent)) - bent).norm(dim=-1).numpy()
    layer = np.array([camera.layer for camera in imager.cameras])
    median = [np.median(error[layer == k][imager.visible[layer == k]]) for k in (0, 1)]
    assert min(imager.visible[layer == k].mean() for k in (0, 1)) > 0.4
    # Seen: 0.12 and 0.12 mm by front and back, 0.16 and 0.16 mm by four, where a pixel spans 4 mm.
    assert median[0] < 4e-4
    assert median[1] < 1.2 * median[0]
    assert not (imager.visible[0] & imager.visible[1]).any()


def test_layers_that_show_nothing_are_left_out_unless_the_cameras_are_given():
    garment = TemplateImager.build(two_quads(), views="front,back", size=(40, 40), layers=4)
    assert [camera.name for camera in garment.cameras] == ["front", "front/1", "back", "back/1"]
    assert garment.visible.shape == (4, 8)
    # Another mesh seen by the same cameras keeps their images, empty or not, so that the two can be paired.
    other = TemplateImager.build(two_triangles(), cameras=garment.cameras)
    assert other.mask.any(dim=(1, 2)).tolist() == [True, False, True, False]
    assert not other.visible[[1, 3]].any()
    assert torch.equal(other.operator(torch.ones(4, 1))[1], torch.zeros(40, 40, 1))


def test_more_views_see_more_of_a_garment():
    mesh = tube()
    two = TemplateImager.build(mesh, size=(128, 128)).visible
    four = TemplateImager.build(mesh, size=(128, 128), views=("front", "back", "left", "right")).visible
    np.testing.assert_array_equal(two, four[:2])
    assert 0.85 < two.any(axis=0).mean() < four.any(axis=0).mean()
    assert four.any(axis=0).mean() > 0.99
