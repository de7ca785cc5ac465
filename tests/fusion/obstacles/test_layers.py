"""Garments worn beneath: an open surface pushes outwards where it covers, and nowhere else."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from fusion import BodySdf, Obstacles, OuterSurface, Topology, lift_clear
from fusion.obstacles.layers import _rims
from render import InputError, Mesh
from tests.helpers.fusion_examples import AROUND, cylinder_body, leaning, tube
from tests.helpers.half_space import HalfSpace
from tests.helpers.paths import EXTERNAL

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])  # at y = 0, its outer side up
SQUARE_FACES = np.array([[0, 2, 1], [0, 3, 2]])
CLEARANCE = 1e-3


def square(**settings: float) -> OuterSurface:
    surface = OuterSurface(SQUARE_FACES, 4, **settings)
    surface.update(SQUARE)
    return surface


def surface_of(mesh: Mesh, **settings: float) -> OuterSurface:
    surface = OuterSurface(mesh.faces, len(mesh.vertices), **settings)
    surface.update(mesh.vertices[None])
    return surface


def test_hand_values_above_and_below_a_square():
    points = torch.tensor([[0.3, 0.02, 0.4], [0.3, -0.02, 0.4], [0.5, -0.02, 0.5]])
    found = square().query(points)
    torch.testing.assert_close(found.distance, torch.tensor([0.02, -0.02, -0.02]))
    torch.testing.assert_close(found.direction, torch.tensor([[0.0, 1.0, 0.0]] * 3))
    torch.testing.assert_close(found.closest, torch.tensor([[0.3, 0, 0.4], [0.3, 0, 0.4], [0.5, 0, 0.5]]))


@pytest.mark.parametrize(
    ("where", "point"),
    {
        "past an edge": [1.01, -0.005, 0.5],
        "past the edge, above": [1.01, 0.005, 0.5],
        "past a corner": [-0.01, -0.005, -0.01],
        "deeper than the band below": [0.5, -0.11, 0.5],
        "farther than the band above": [0.5, 0.06, 0.5],
        "far away": [5.0, 5.0, 5.0],
    }.items(),
)
def test_free_points_have_the_band_and_no_direction(where, point):
    found = square().query(torch.tensor([point]))
    assert found.distance.item() == pytest.approx(0.05)
    assert found.direction.tolist() == [[0.0, 0.0, 0.0]]
    torch.testing.assert_close(found.closest, torch.tensor([point]))


def test_a_raised_surface_is_nearer_by_its_offset():
    points = torch.tensor([[0.3, 0.02, 0.4], [0.3, -0.02, 0.4], [0.3, 0.052, 0.4]])
    found = square(offset_m=0.003).query(points)
    torch.testing.assert_close(found.distance, torch.tensor([0.017, -0.023, 0.049]), atol=1e-6, rtol=0)
    torch.testing.assert_close(found.direction, torch.tensor([[0.0, 1.0, 0.0]] * 3))


def test_a_hole_pushes_nothing_and_an_inner_vertex_does():
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), -1).reshape(-1, 2)
    vertices = np.stack([grid[:, 0], 0 * grid[:, 0], grid[:, 1]], axis=1) * 0.1
    a = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    squares = np.stack([[a, a + 1, a + 5], [a, a + 5, a + 4]], axis=1).transpose(2, 1, 0)  # (9, 2, 3)
    whole = squares.reshape(-1, 3)
    holed = np.delete(squares, 4, axis=0).reshape(-1, 3)  # without the middle
    below = torch.tensor([[0.15, -0.01, 0.15], [0.1, -0.01, 0.1], [0.05, -0.01, 0.05]])
    for faces, free in ((whole, [False, False, False]), (holed, [True, True, False])):
        surface = OuterSurface(faces, 16)
        surface.update(vertices)
        distance = surface.query(below).distance
        assert [value == pytest.approx(0.05) for value in distance.tolist()] == free


def test_the_gradient_is_the_direction_and_zero_for_free_points():
    points = torch.tensor([[0.3, -0.02, 0.4], [2.0, 0.0, 0.4]], dtype=torch.float64, requires_grad=True)
    distance = square().distance(points)
    (distance * torch.tensor([2.0, 3.0])).sum().backward()
    assert distance.dtype == torch.float64
    want = torch.tensor([[0.0, 2, 0], [0, 0, 0]], dtype=torch.float64)
    torch.testing.assert_close(points.grad, want, atol=1e-5, rtol=0)  # float32 rounding over 2 cm


def test_a_pose_per_frame_equals_single_poses_and_follows_updates():
    mesh = tube()
    poses = leaning(mesh.vertices, 3)
    points = torch.from_numpy(poses + np.random.default_rng(0).normal(0, 0.01, poses.shape)).float()
    batched, single = (OuterSurface(mesh.faces, len(mesh.vertices)) for _ in range(2))
    for order in ([0, 1, 2], [2, 0], [1, 2, 0]):
        batched.update(poses[order])
        found = batched.query(points[order])
        for row, frame in enumerate(order):
            single.update(poses[frame])
            torch.testing.assert_close(found.distance[row], single.query(points[frame]).distance)


def test_moving_everything_rigidly_turns_the_directions_along():
    mesh = tube()
    pose = leaning(mesh.vertices, 2)
    points = mesh.vertices * 1.05 + 0.004
    moved = np.linalg.lstsq(mesh.vertices, pose[1], rcond=None)[0]
    surface = OuterSurface(mesh.faces, len(mesh.vertices))
    surface.update(mesh.vertices)
    before = surface.query(torch.from_numpy(points))
    surface.update(pose[1])
    after = surface.query(torch.from_numpy(points @ moved))
    torch.testing.assert_close(after.distance, before.distance, atol=2e-6, rtol=0)
    turned = before.direction @ torch.from_numpy(moved).float()
    torch.testing.assert_close(after.direction, turned, atol=2e-3, rtol=0)


@pytest.mark.parametrize("sunk", [0.002, 0.01, 0.05])
def test_an_outer_tube_that_sank_below_comes_out_everywhere_it_is_covered(sunk):
    inner, outer = tube(radius=0.15, height=0.3), tube(radius=0.15 - sunk, height=0.4)
    surface = surface_of(inner, offset_m=0.002)
    cloth = torch.from_numpy(outer.vertices).float()[None]
    covered = torch.from_numpy(np.abs(outer.vertices[:, 1]) < 0.15 - 1e-6)
    assert (surface.query(cloth).distance[0, covered] < 0).all()
    found = lift_clear(cloth, surface, Topology(outer), clearance_m=CLEARANCE, rounds=10)
    radius = found.vertices[0, :, ::2].norm(dim=-1)
    flat = np.cos(np.pi / AROUND)  # the middle of a side of the tube is nearer to its axis
    assert radius[covered].min() > 0.15 * flat + 0.003 - 1e-6
    assert surface.query(found.vertices).distance.min() >= CLEARANCE
    ends = torch.from_numpy(np.abs(outer.vertices[:, 1]) > 0.19)
    assert (radius[ends] - (0.15 - sunk)).abs().max() < sunk + 0.004  # free, and moved only as a neighbour


def test_a_vertex_deep_in_the_body_comes_out_of_body_and_garment():
    body, inner, outer = cylinder_body(), tube(radius=0.14, height=0.5), tube(radius=0.05)
    sdf, surface = BodySdf(body.faces, len(body.vertices)), OuterSurface(inner.faces, len(inner.vertices))
    both = Obstacles([sdf, surface])
    both.update(body.vertices[None], inner.vertices[None])
    cloth = torch.from_numpy(outer.vertices).float()[None]
    found = lift_clear(cloth, both, Topology(outer), clearance_m=CLEARANCE, rounds=10)
    assert not found.remaining.any()
    assert sdf.query(found.vertices).distance.min() >= CLEARANCE
    assert surface.query(found.vertices).distance.min() >= CLEARANCE


def test_several_obstacles_are_the_nearest_of_them():
    body, inner = cylinder_body(), tube(radius=0.14)
    sdf = BodySdf(body.faces, len(body.vertices), band_m=0.05)
    surface = OuterSurface(inner.faces, len(inner.vertices))
    both = Obstacles([sdf, surface])
    both.update(body.vertices, inner.vertices)
    points = torch.from_numpy(np.random.default_rng(0).uniform(-0.2, 0.2, (300, 3))).requires_grad_()
    found, parts = both.query(points), [sdf.query(points), surface.query(points)]
    chosen = [0, 0]
    for row in range(300):
        nearest = min((0, 1), key=lambda part: float(parts[part].distance[row]))
        chosen[nearest] += 1
        for name in ("distance", "direction", "closest"):
            assert torch.equal(getattr(found, name)[row], getattr(parts[nearest], name)[row])
    assert min(chosen) > 20
    both.distance(points).sum().backward()
    torch.testing.assert_close(points.grad, found.direction.double())


def test_no_points():
    assert square().query(torch.zeros(0, 3)).distance.shape == (0,)


def test_wrong_input_is_named():
    with pytest.raises(InputError, match="inner_faces"):
        OuterSurface(SQUARE_FACES, 3)
    with pytest.raises(InputError, match="band_m"):
        OuterSurface(SQUARE_FACES, 4, band_m=0.0)
    with pytest.raises(InputError, match="offset_m"):
        OuterSurface(SQUARE_FACES, 4, offset_m=-0.001)
    with pytest.raises(InputError, match="call update"):
        OuterSurface(SQUARE_FACES, 4).query(torch.zeros(1, 3))
    with pytest.raises(InputError, match="inner_vertices must have shape"):
        OuterSurface(SQUARE_FACES, 4).update(SQUARE[:3])
    with pytest.raises(InputError, match="at least one obstacle"):
        Obstacles([])
    with pytest.raises(InputError, match="2 arrays of vertices are wanted, found 1"):
        Obstacles([square(), square()]).update(SQUARE)


@pytest.mark.skipif(not (EXTERNAL / "unpack.py").is_file(), reason=f"no external clips at {EXTERNAL}")
def test_a_simulated_dress_over_a_simulated_t_shirt(tmp_path: Path) -> None:
    """Both were simulated alone on the same moving body, so they run through each other."""
    (tmp_path / "packed").mkdir()
    for name in ("dress_vb3.npz", "tshirt_vb3.npz"):
        (tmp_path / "packed" / name).symlink_to(EXTERNAL / name)
    unpack = [sys.executable, str(EXTERNAL / "unpack.py"), f"{tmp_path}/npz", f"{tmp_path}/packed"]
    subprocess.run(unpack, check=True, capture_output=True)
    dress, shirt = (np.load(tmp_path / "npz" / f"{name}_vb3.npz") for name in ("dress", "tshirt"))
    frames = [0, 37, 74]
    sdf = BodySdf(dress["body_faces"], dress["body_vertices"].shape[1])
    surface = OuterSurface(shirt["garment_faces"], shirt["garment_vertices"].shape[1])
    both = Obstacles([sdf, surface])
    both.update(dress["body_vertices"][frames], shirt["garment_vertices"][frames])
    cloth = torch.from_numpy(dress["garment_vertices"][frames])
    topology = Topology(Mesh(dress["template_vertices"], dress["garment_faces"]))
    assert (surface.query(cloth).distance < 0).float().mean() > 0.2
    found = lift_clear(cloth, both, topology, clearance_m=CLEARANCE, rounds=10)
    assert not found.remaining.any()
    assert sdf.query(found.vertices).distance.min() >= CLEARANCE
    assert surface.query(found.vertices).distance.min() >= CLEARANCE
    assert (found.vertices - cloth).norm(dim=-1).mean() < 0.005


def test_a_body_is_a_surface_too():
    """Without a rim, an outer surface is a body with a band below."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    surface = OuterSurface(ball.faces, len(ball.vertices))
    surface.update(ball.vertices)
    sdf = BodySdf(ball.faces, len(ball.vertices), band_m=0.05)
    sdf.update(ball.vertices)
    points = torch.from_numpy(np.random.default_rng(1).normal(0, 0.04, (500, 3)))
    torch.testing.assert_close(surface.query(points).distance, sdf.query(points).distance)


def test_rims_of_an_open_a_closed_and_a_pinched_mesh():
    """1 where the corner is on the rim, 2 where the edge opposite it is."""
    one = np.array([[0, 1, 2]])
    assert _rims(one, 3).tolist() == [[3, 3, 3]]
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert not _rims(tetrahedron, 4).any()
    # Of a square's two triangles all vertices are on the rim, and the diagonal 0-2 alone is not.
    assert _rims(np.array([[0, 1, 2], [0, 2, 3]]), 4).tolist() == [[3, 1, 3], [3, 3, 1]]
    # Around an inner vertex, 4, no edge at it is on the rim.
    fan = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    assert _rims(fan, 5).tolist() == [[1, 1, 2]] * 4
    # An edge of three faces is no rim.
    assert _rims(np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]), 5)[:, 2].tolist() == [1, 1, 1]


def test_every_part_takes_its_own_pose_and_the_highest_ground_answers():
    parts = HalfSpace(), HalfSpace()
    ground = Obstacles(parts)
    ground.update(torch.tensor([0.5]), torch.tensor([0.25]))
    assert [part.height for part in parts] == [0.5, 0.25]
    answer = ground.query(torch.ones(1, 1, 3))
    assert answer.distance.tolist() == [[0.5]]
    assert answer.closest.tolist() == [[[1, 0.5, 1]]]
    with pytest.raises(InputError, match="2 arrays of vertices are wanted, found 1"):
        ground.update(torch.zeros(1))
