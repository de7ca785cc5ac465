"""After the clean-up no vertex is in the body, however deep it was."""

import numpy as np
import pytest
import torch
import trimesh

from fusion import BodySdf, FusionConfig, OuterSurface, Topology, clear_body, fuse, lift_clear
from fusion.obstacles.clearance import _sphere
from fusion.obstacles.lifting import SdfCache, padded_places, pulled
from render import Mesh
from tests.helpers.example_meshes import two_triangles
from tests.helpers.fusion_examples import (
    AROUND,
    cylinder_body,
    imager_of,
    inputs_of,
    leaning,
    true_maps,
    tube,
    wrinkled,
)
from tests.helpers.half_space import HalfSpace

CLEARANCE = 1e-3
MESH = tube()
TOPOLOGY = Topology(MESH)
TUBE = torch.from_numpy(MESH.vertices).float()[None]
SIDEWAYS = torch.tensor([1.0, 0.0, 1.0])
MIDDLE = 8 * AROUND  # the vertex at x = 0, y = 0, z = 0.15


def body_sdf(*meshes: trimesh.Trimesh) -> BodySdf:
    body = trimesh.util.concatenate(meshes)
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(body.vertices[None])
    return sdf


def stretch(vertices: torch.Tensor) -> torch.Tensor:
    return TOPOLOGY.difference(vertices).norm(dim=-1) / TOPOLOGY.rest_lengths.float()


def one_vertex(scale: float) -> torch.Tensor:
    vertices = TUBE.clone()
    vertices[0, MIDDLE] *= 1 + (scale - 1) * SIDEWAYS
    return vertices


def dent() -> torch.Tensor:
    """A dent of 20 cm: past the middle of the body, which is 26 cm thick."""
    near = torch.exp(-(TUBE[0] - TUBE[0, MIDDLE]).square().sum(-1) / 0.06**2)
    return TUBE - 0.2 * near[None, :, None] * torch.tensor([0.0, 0.0, 1.0])


def shrunk(scale: float) -> torch.Tensor:
    return TUBE * (1 + (scale - 1) * SIDEWAYS)


DEEP = {
    "a vertex 11 cm inside": one_vertex(0.1),
    "a vertex past the middle": one_vertex(-0.4),
    "a dent past the middle": dent(),
    "all of it 7 cm inside": shrunk(0.4),
    "all of it near the axis": shrunk(0.07),
    "all of it in one point": 0 * TUBE,
    "moved by 10 cm": TUBE + torch.tensor([0.1, 0.0, 0.0]),
}


@pytest.mark.parametrize("name", DEEP)
def test_nothing_stays_inside_however_deep_it_was(name):
    sdf = body_sdf(cylinder_body())
    before = DEEP[name].clone()
    assert sdf.query(before).distance.min() < -0.06
    found = lift_clear(DEEP[name], sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
    torch.testing.assert_close(DEEP[name], before, rtol=0, atol=0)
    assert sdf.query(found.vertices).distance.min() >= CLEARANCE
    assert not found.remaining.any()
    exact = sdf.query(found.vertices).distance
    near = exact < CLEARANCE + 4e-4
    assert torch.equal(found.distance[near], exact[near])
    assert (found.distance <= exact).all()
    assert 1 <= found.rounds <= 4
    assert found.queried <= 2.01


@pytest.mark.parametrize("scale", [0.1, -0.4])
def test_a_deep_vertex_comes_out_on_the_side_of_its_neighbours_without_a_spike(scale):
    found = clear_body(
        one_vertex(scale), body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=10
    )
    assert found[0, MIDDLE, 2] > 0.13
    assert stretch(found).max() < 1.5
    far = (TUBE[0] - TUBE[0, MIDDLE]).norm(dim=-1) > 0.05
    torch.testing.assert_close(found[0, far], TUBE[0, far], rtol=0, atol=0)


def test_a_dent_past_the_middle_comes_out_in_front():
    found = clear_body(dent(), body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
    front = TUBE[0, :, 2] > 0.05
    assert found[0, front, 2].min() > 0
    assert stretch(found).max() <= stretch(dent()).max()


def test_a_shallow_vertex_gets_the_clearance_and_its_neighbours_make_half_of_its_step():
    """Hand values: the body's side is the plane x = 0, one vertex of a strip is 4 mm behind it."""
    x = [0.01, -0.004, 0.01, 0.01]
    strip = np.stack([x, [0.0, 0.1, 0.2, 0.1], [0.0, 0.0, 0.0, 0.1]], axis=1)
    topology = Topology(Mesh(strip, np.array([[0, 1, 3], [1, 2, 3]])))
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    box.apply_translation([-1.0, 0.0, 0.0])
    sdf = body_sdf(box)
    found = clear_body(torch.from_numpy(strip)[None], sdf, topology, clearance_m=CLEARANCE, rounds=3)
    # Lifted by 5 mm; vertices 0 and 2 have two neighbours, vertex 3 has three: half of 5 / 2 and of 5 / 3.
    want = [0.01 + 0.00125, 0.001, 0.01 + 0.00125, 0.01 + 0.005 / 6]
    np.testing.assert_allclose(found[0, :, 0], want, atol=5e-6)
    np.testing.assert_allclose(found[0, :, 1:], strip[:, 1:], atol=1e-7)
    assert found.dtype == torch.float64


def test_clear_vertices_are_not_moved_and_cost_one_query():
    found = lift_clear(TUBE, body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
    torch.testing.assert_close(found.vertices, TUBE, rtol=0, atol=0)
    assert (found.rounds, found.queried) == (0, 1.0)


def test_no_rounds_leave_the_vertices_as_they_are():
    found = lift_clear(shrunk(0.4), body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=0)
    torch.testing.assert_close(found.vertices, shrunk(0.4), rtol=0, atol=0)
    assert found.remaining.all()
    assert found.distance.min().item() == pytest.approx(-0.07, abs=1e-3)


def test_pinned_vertices_stay_and_are_named():
    fixed = torch.zeros(len(MESH.vertices), dtype=torch.bool)
    fixed[:AROUND] = True
    found = lift_clear(
        shrunk(0.4), body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=10, fixed=fixed
    )
    torch.testing.assert_close(found.vertices[:, fixed], shrunk(0.4)[:, fixed], rtol=0, atol=0)
    assert torch.equal(found.remaining[0], fixed)


def test_pinned_vertices_do_not_follow_their_neighbours():
    fixed = torch.ones(len(MESH.vertices), dtype=torch.bool)
    fixed[MIDDLE] = False
    found = clear_body(
        one_vertex(0.85), body_sdf(cylinder_body()), TOPOLOGY, clearance_m=CLEARANCE, rounds=10, fixed=fixed
    )
    torch.testing.assert_close(found[:, fixed], TUBE[:, fixed], rtol=0, atol=0)


def test_a_batch_equals_its_frames():
    cases = torch.cat(list(DEEP.values()))
    body = cylinder_body()
    bodies = np.stack([body.vertices + 0.002 * k for k in range(len(cases))])
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(bodies)
    together = clear_body(cases, sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
    for k, case in enumerate(cases):
        sdf.update(bodies[k : k + 1])
        alone = clear_body(case[None], sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
        torch.testing.assert_close(together[k : k + 1], alone, rtol=0, atol=1e-6)


@pytest.mark.parametrize("rounds", [1, 3, 10])
def test_vertices_in_two_limbs_at_once_come_out_of_both(rounds):
    """An arm sunk into a trunk: the way out of one part often leads into the other."""
    arm = trimesh.creation.capsule(height=0.5, radius=0.045, count=[24, 24])
    arm.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2 - 0.3, [1, 0, 0]))
    arm.apply_translation([0.14, 0.1, 0.0])
    sdf = body_sdf(cylinder_body(), arm)
    random = np.random.default_rng(0)
    cloth = torch.from_numpy(random.uniform([0.0, -0.2, -0.1], [0.2, 0.2, 0.1], TUBE[0].shape)).float()[None]
    assert (sdf.query(cloth).distance < 0).sum() > 200
    found = lift_clear(cloth, sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=rounds)
    assert sdf.query(found.vertices).distance.min() >= CLEARANCE
    assert not found.remaining.any()


def test_a_fold_between_two_limbs_is_left_along_its_middle():
    """Two cylinders touch; vertices where less than the clearance is free on either side move along the gap."""
    left, right = cylinder_body(0.1), cylinder_body(0.1)
    left.apply_translation([-0.1001, 0.0, 0.0])
    right.apply_translation([0.1001, 0.0, 0.0])
    sdf = body_sdf(left, right)
    cloth = TUBE.clone()
    cloth[0, MIDDLE] = torch.tensor([0.0, 0.0, 0.01])
    assert 0 < sdf.query(cloth[:, MIDDLE : MIDDLE + 1]).distance < CLEARANCE
    found = lift_clear(cloth, sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=10)
    assert sdf.query(found.vertices[:, MIDDLE : MIDDLE + 1]).distance >= CLEARANCE


def test_a_gap_too_narrow_for_any_clearance_is_left_by_the_search():
    boxes = [trimesh.creation.box((0.2, 0.2, 0.2)) for _ in range(2)]
    boxes[0].apply_translation([-0.1005, 0.0, 0.0])
    boxes[1].apply_translation([0.1005, 0.0, 0.0])
    sdf = body_sdf(*boxes)
    sheet = np.array([[0.0, 0.3, 0.0], [0.0, 0.05, 0.0], [0.0, 0.3, 0.1]])
    topology = Topology(Mesh(sheet, np.array([[0, 1, 2]])))
    found = lift_clear(torch.from_numpy(sheet)[None], sdf, topology, clearance_m=CLEARANCE, rounds=6)
    assert found.relocated.tolist() == [[False, True, False]]
    assert sdf.query(found.vertices).distance.min() >= CLEARANCE
    assert (found.vertices[0, 1] - torch.from_numpy(sheet)[1]).norm() < 0.08  # 5 cm to the gap's upper end


def test_no_frames_are_no_trouble():
    body = cylinder_body()
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(body.vertices)
    found = lift_clear(torch.zeros(0, 4, 3), sdf, TOPOLOGY, clearance_m=CLEARANCE, rounds=3)
    assert found.vertices.shape == (0, 4, 3)
    assert found.distance.shape == (0, 4)


@pytest.mark.parametrize("solver", ["local_global", "adam"])
@pytest.mark.parametrize("wrong", ["8 cm off", "all of it inside"])
def test_after_fusing_a_prediction_deep_inside_nothing_is_in_the_body_or_the_garment_beneath(solver, wrong):
    imager, body, inner = imager_of(MESH), cylinder_body(), tube(radius=0.135, height=0.3)
    positions, normals = true_maps(imager, wrinkled(MESH, 2))
    mask = torch.from_numpy(imager.raster.mask)[None, ..., None]
    positions = (
        positions * 0.3 if wrong == "all of it inside" else positions + torch.tensor([0, 0, 0.08]) * mask
    )
    bodies, inners = leaning(body.vertices, 2), leaning(inner.vertices, 2)
    config = FusionConfig(solver=solver, inner_margin_m=0.002, edge_steps=20, normal_steps=20)
    found = fuse(
        imager,
        inputs_of(
            positions=positions, normals=normals, body=(bodies, body.faces), inner=(inners, inner.faces)
        ),
        config,
    )
    vertices = torch.from_numpy(found.vertices)
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(bodies)
    surface = OuterSurface(inner.faces, len(inner.vertices), offset_m=config.inner_margin_m)
    surface.update(inners)
    for obstacle in (sdf, surface):
        assert obstacle.query(vertices).distance.min() >= config.clearance_m


def test_places_that_are_chosen_are_padded_to_the_longest_row():
    chosen = torch.tensor([[False, True, False, True], [True, False, False, False], [False] * 4])
    places = padded_places(chosen)
    assert places.shape == (3, 2)
    assert places[0].tolist() == [1, 3]
    assert places[1, 0].item() == 0
    assert len(set(places[2].tolist())) == 2  # any two, but not one twice
    assert padded_places(torch.zeros(2, 4, dtype=torch.bool)).shape == (2, 0)
    assert padded_places(torch.zeros(0, 4, dtype=torch.bool)).shape == (0, 0)


def test_directions_of_the_search_are_spread_evenly():
    directions = _sphere(64)
    torch.testing.assert_close(directions.norm(dim=-1), torch.ones(64).double())
    assert directions.mean(0).abs().max() < 0.01
    # Second moments of the sphere are 1/3 and 0; each has a neighbour within 30 degrees, none within 10.
    torch.testing.assert_close(directions.T @ directions / 64, torch.eye(3).double() / 3, atol=0.01, rtol=0)
    nearest = (directions @ directions.T - 2 * torch.eye(64)).max(1).values
    assert (nearest > np.cos(np.deg2rad(30))).all()
    assert (nearest < np.cos(np.deg2rad(10))).all()


def test_only_vertices_that_moved_are_asked_about_again():
    space = HalfSpace()
    vertices = torch.rand(2, 5, 3, generator=torch.Generator().manual_seed(0))
    cache = SdfCache(vertices, space, 0.1)
    moved = vertices.clone()
    moved[0, [1, 4], 1], moved[1, 2, 1] = 7.0, 8.0
    cache.move(moved)
    assert space.queries[1].tolist() == [moved[place].tolist() for place in ((0, 1), (0, 4), (1, 2))]
    assert cache.distance.equal(moved[..., 1])
    assert cache.asked == 2 * 5 + 3
    cache.move(moved.clone())
    assert cache.asked == 13


def test_a_deep_vertex_is_pulled_until_its_edges_are_no_more_than_half_as_long_again():
    """One vertex of a square 5 m away from the others: of its edges the shortest one's length counts."""
    topology = Topology(two_triangles())
    vertices = torch.from_numpy(two_triangles().vertices).float()[None].clone()
    vertices[0, 1] += torch.tensor([0.0, 0, -5.0])
    deep = torch.tensor([[False, True, False, False]])
    found = pulled(vertices, deep, topology)
    lengths = topology.difference(found).norm(dim=-1)[0]
    assert lengths.max() < 1.51 * topology.rest_lengths.max()
    assert torch.equal(found[0, ~deep[0]], vertices[0, ~deep[0]])
    assert torch.equal(pulled(vertices, ~deep & deep, topology), vertices)  # nothing is deep


def test_on_flat_ground_each_vertex_gets_what_is_missing_straight_up():
    vertices = torch.tensor([[[0.0, -0.004, 0], [1, 0.0005, 0], [0, 0.5, 0]]])
    topology = Topology(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 0.5, 0]]), np.array([[0, 1, 2]])))
    found = lift_clear(
        vertices, HalfSpace(), topology, clearance_m=1e-3, rounds=2
    )  # the last two: none follows
    want = vertices.clone()
    want[0, :2, 1] = 1e-3
    torch.testing.assert_close(found.vertices, want, rtol=0, atol=5e-6)
    assert found.rounds == 1
    assert not found.remaining.any()
    assert not found.relocated.any()
    assert found.distance.min() >= 1e-3
