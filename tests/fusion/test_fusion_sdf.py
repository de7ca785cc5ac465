"""Signed distance against shapes whose distance is known."""

import subprocess
import sys

import numpy as np
import pytest
import torch
import trimesh

from fusion import BodySdf
from render import InputError

SIGNS = ("checked", "winding", "normal")


def sphere(radius: float = 0.5, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def sdf_of(mesh: trimesh.Trimesh, sign: str = "checked") -> BodySdf:
    sdf = BodySdf(mesh.faces, len(mesh.vertices), sign=sign)
    sdf.update(mesh.vertices)
    return sdf


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    outside = np.abs(points) - half
    return np.linalg.norm(np.maximum(outside, 0), axis=-1) + np.minimum(outside.max(-1), 0)


@pytest.mark.parametrize("sign", SIGNS)
def test_distance_to_a_sphere_inside_and_outside(sign):
    points = torch.randn(500, 3, generator=torch.Generator().manual_seed(0)) * 0.5
    want = points.norm(dim=-1) - 0.5
    assert (want < 0).sum() > 50
    # The icosphere's faces lie up to r (1 - cos(half an edge's angle)) = 0.5 mm inside the sphere.
    torch.testing.assert_close(sdf_of(sphere(), sign).distance(points), want, rtol=0, atol=6e-4)


@pytest.mark.parametrize("sign", SIGNS)
def test_distance_to_a_box_is_exact_at_faces_edges_and_corners(sign):
    half = np.array([0.3, 0.5, 0.2])
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 3)) * 0.8
    found = sdf_of(trimesh.creation.box(2 * half), sign).distance(torch.from_numpy(points))
    assert found.dtype == torch.float64
    np.testing.assert_allclose(found.numpy(), box_distance(points, half), atol=1e-6)  # a few float32 ulps


def test_hand_values_of_the_query_beside_a_box():
    points = torch.tensor([[1.5, 0.2, 0.1], [0.75, 0.2, 0.1]])
    found = sdf_of(trimesh.creation.box((2.0, 2.0, 2.0))).query(points)
    torch.testing.assert_close(found.distance, torch.tensor([0.5, -0.25]))
    torch.testing.assert_close(found.closest, torch.tensor([[1.0, 0.2, 0.1]] * 2))
    torch.testing.assert_close(found.direction, torch.tensor([[1.0, 0.0, 0.0]] * 2))


def test_gradient_is_the_direction_and_agrees_with_differences():
    half = np.array([0.3, 0.5, 0.2])
    points = torch.from_numpy(np.random.default_rng(2).uniform(-0.7, 0.7, (200, 3))).requires_grad_()
    cotangent = torch.rand(200, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    (sdf_of(trimesh.creation.box(2 * half)).distance(points) * cotangent).sum().backward()
    x, step = points.detach().numpy(), 1e-6
    ahead = [box_distance(x + step * axis, half) for axis in np.eye(3)]
    behind = [box_distance(x - step * axis, half) for axis in np.eye(3)]
    differences = (np.stack(ahead, -1) - np.stack(behind, -1)) / (2 * step)
    np.testing.assert_allclose(points.grad.numpy(), cotangent.numpy()[:, None] * differences, atol=1e-5)


def test_a_point_on_the_surface_gets_the_face_normal_not_nan():
    points = torch.tensor([[1.0, 0.3, 0.2]], requires_grad=True)
    sdf_of(trimesh.creation.box((2.0, 2.0, 2.0))).distance(points).sum().backward()
    torch.testing.assert_close(points.grad, torch.tensor([[1.0, 0.0, 0.0]]))


def test_a_body_per_frame_equals_single_bodies_and_follows_updates():
    mesh = sphere()
    rng = np.random.default_rng(4)
    bodies = np.stack([mesh.vertices, mesh.vertices * 0.7 + 0.1, mesh.vertices - [0.0, 0.4, 0.0]])
    points = torch.from_numpy(rng.normal(0, 0.4, (3, 50, 3)))
    batched = BodySdf(mesh.faces, len(mesh.vertices))
    single = BodySdf(mesh.faces, len(mesh.vertices))
    for order in ([0, 1, 2], [2, 0], [1, 2, 0]):  # the batch shrinks and grows again
        batched.update(bodies[order])
        found = batched.distance(points[order])
        for row, frame in enumerate(order):
            single.update(bodies[frame])
            torch.testing.assert_close(found[row], single.distance(points[frame]), rtol=0, atol=1e-6)


def test_winding_number_sees_the_inside_of_overlapping_limbs():
    """A thin rod sunk into a sphere, as an arm pressed into the torso: the closest surface is the rod, which
    faces the point, yet the point is inside the body."""
    rod = trimesh.creation.cylinder(radius=0.05, height=0.6, sections=32)
    body = trimesh.util.concatenate([sphere(), rod])
    point = torch.tensor([[0.07, 0.01, 0.02]])
    assert sdf_of(body, "normal").distance(point).item() > 0
    assert sdf_of(body, "winding").distance(point).item() < 0


def test_winding_number_survives_a_hole():
    mesh = sphere()
    hole = mesh.triangles_center[:, 1] < 0.495  # the eyes and mouth are cut out of the body mesh like this
    sdf = BodySdf(mesh.faces[hole], len(mesh.vertices))
    sdf.update(mesh.vertices)
    points = torch.tensor([[0.0, 0.3, 0.0], [0.0, 0.7, 0.0], [0.45, 0.0, 0.0], [0.55, 0.0, 0.0]])
    assert (sdf.distance(points) < 0).tolist() == [True, False, True, False]


def test_leading_axes_and_no_points():
    sdf = sdf_of(sphere())
    points = torch.randn(2, 3, 4, 3)
    torch.testing.assert_close(sdf.distance(points)[1, 2], sdf.distance(points[1, 2]))
    assert sdf.distance(torch.zeros(0, 3)).shape == (0,)


def test_wrong_input_is_named():
    mesh = sphere()
    sdf = BodySdf(mesh.faces, len(mesh.vertices))
    with pytest.raises(InputError, match="call update"):
        sdf.query(torch.zeros(1, 3))
    with pytest.raises(InputError, match="body_vertices must have shape"):
        sdf.update(mesh.vertices[:-1])
    with pytest.raises(InputError, match="not finite"):
        sdf.update(np.full_like(mesh.vertices, np.nan))
    with pytest.raises(InputError, match="body_faces"):
        BodySdf(mesh.faces, 3)
    sdf.update(np.stack([mesh.vertices] * 2))
    with pytest.raises(InputError, match="one frame a body"):
        sdf.query(torch.zeros(5, 3))
    sdf.update(mesh.vertices)
    with pytest.raises(InputError, match="not finite"):
        sdf.query(torch.tensor([[0.0, 0.0, 0.0], [float("nan"), 0.0, 0.0]]))


def test_warp_prints_no_banner():
    code = (
        "import numpy as np, torch; from fusion import BodySdf; "
        "s = BodySdf(np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]]), 4); "
        "s.update(np.vstack([np.zeros(3), np.eye(3)])); s.distance(torch.ones(1, 3))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""
