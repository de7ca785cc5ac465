"""Cloth that is in an obstacle between its vertices: contacts by hand, and what the clean-up makes of them."""

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from fusion import BodySdf, Obstacles, OuterSurface, Topology, lift_clear
from fusion.obstacles.bvh import MeshBvh
from fusion.obstacles.crossings import edges_through_faces
from fusion.obstacles.surface_contact import SurfaceContact, SurfaceContacts, _Surface
from fusion.solvers.contact import ConstrainedStep, Contact
from fusion.solvers.energy import Energy
from render import Mesh
from render.mesh.normals import VertexNormals
from tests.helpers.half_space import HalfSpace

CLEAR = 2e-4  # metres that a point gets in front of the surface
CPU = torch.device("cpu")
ONE = Mesh(np.array([[0.3, 0, 0], [-0.15, 0.26, 0], [-0.15, -0.26, 0]]), np.array([[0, 1, 2]]))


def posed(body: trimesh.Trimesh) -> BodySdf:
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(np.asarray(body.vertices)[None])
    return sdf


def hull(points) -> trimesh.Trimesh:
    return trimesh.Trimesh(points).convex_hull


def ball(subdivisions: int, radius: float = 0.1) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions, radius)


def tensor(points) -> torch.Tensor:
    return torch.from_numpy(np.asarray(points, np.float32))[None]


def contacts_of(sdf, cloth: Mesh) -> SurfaceContacts | None:
    points = tensor(cloth.vertices)
    return SurfaceContact(sdf, Topology(cloth), CPU).find(points, sdf.query(points).distance)


def crossings(points, cloth, body) -> int:
    """Edges of either through faces of the other."""
    points, other = np.asarray(points, np.float32), np.asarray(body.vertices, np.float32)[None]
    wearer = Mesh(other[0], body.faces)
    return int(
        edges_through_faces(points, cloth.edges, other, body.faces).counts().sum()
        + edges_through_faces(other, wearer.edges, points, cloth.faces).counts().sum()
    )


SPIKE = hull([[0, 0, 0.005], [0.05, 0, -0.2], [-0.05, 0.04, -0.2], [-0.05, -0.04, -0.2]])


def test_a_spike_through_the_middle_of_a_triangle_lifts_its_corners_alike():
    """Its tip is 5 mm in front of the middle: that must move by 5 mm and what is left clear, and with it all three."""
    contacts = contacts_of(posed(SPIKE), ONE)
    # Edges of the cloth pass through nothing; of the spike's vertices the tip alone is near.
    np.testing.assert_allclose(contacts.weights, [[1 / 3] * 3], atol=2e-3)
    np.testing.assert_allclose(contacts.direction, [[0, 0, 1]], atol=2e-5)
    np.testing.assert_allclose(contacts.depth, [0.005 + CLEAR], atol=1e-6)
    lift = contacts.lifts(tensor(ONE.vertices), torch.ones(3, dtype=torch.bool), torch.zeros(1, 3, 3))
    np.testing.assert_allclose(lift[0], [[0, 0, 0.005 + CLEAR]] * 3, atol=2e-5)


def test_edges_across_a_ridge_must_leave_it_halfway_between_their_crossings():
    """A roof of 45 degrees whose ridge is 4 mm above edges across it: their middles are 4 mm / root of 2 deep."""
    roof = hull([[x, y, z] for x in (-1, 1) for y, z in ((0, 0.004), (0.2, -0.196), (-0.2, -0.196))])
    cloth = Mesh(np.array([[0, -0.1, 0], [0, 0.1, 0], [0.1, 0.1, 0]]), np.array([[0, 1, 2]]))
    contacts = contacts_of(posed(roof), cloth)
    assert contacts.corners.tolist() == [[0, 1, 0], [0, 2, 0]]
    np.testing.assert_allclose(contacts.weights, [[0.5, 0.5, 0]] * 2, atol=1e-5)
    np.testing.assert_allclose(contacts.depth, [0.004 / 2**0.5 + CLEAR] * 2, atol=1e-6)
    np.testing.assert_allclose(contacts.direction[:, 2], [0.5**0.5] * 2, atol=1e-4)


def one_contact(weights, depth, frame=0):
    along = torch.tensor([[0.0, 0, 1]])
    return SurfaceContacts(
        torch.tensor([frame]),
        torch.tensor([[0, 1, 2]]),
        torch.tensor([weights]),
        along,
        torch.tensor([depth]),
    )


def test_lifts_are_the_least_that_bring_the_point_there():
    """w d / sum of squares: of 2 mm, weights 0.8 and 0.2 make 1.6 / 0.68 and 0.4 / 0.68 mm."""
    points, loose = torch.zeros(1, 3, 3), torch.ones(3, dtype=torch.bool)
    lift = one_contact([0.8, 0.2, 0.0], 0.002).lifts(points, loose, points)
    np.testing.assert_allclose(lift[0, :, 2], [0.0016 / 0.68, 0.0004 / 0.68, 0], atol=1e-9)


def test_pinned_corners_leave_the_move_to_the_others():
    points, loose = torch.zeros(1, 3, 3), torch.tensor([False, True, True])
    lift = one_contact([0.5, 0.5, 0.0], 0.002).lifts(points, loose, points)
    np.testing.assert_allclose(lift[0, :, 2], [0, 0.004, 0], atol=1e-9)
    none = one_contact([0.5, 0.5, 0.0], 0.002).lifts(points, torch.zeros(3, dtype=torch.bool), points)
    assert torch.equal(none, points)


def test_vertices_do_not_move_towards_what_they_touch():
    """The first one's wall faces down, at 45 degrees: it slides along it, and never up into it."""
    points, loose = torch.zeros(1, 3, 3), torch.ones(3, dtype=torch.bool)
    walls = torch.zeros(1, 3, 3)
    walls[0, 0] = torch.tensor([0.5**0.5, 0, -(0.5**0.5)])
    lift = one_contact([0.5, 0.5, 0.0], 0.002).lifts(points, loose, walls)
    assert (lift[0, 0] * walls[0, 0]).sum().abs() < 1e-9
    assert (0.5 * lift[0, :2, 2]).sum().item() == pytest.approx(0.002, rel=1e-5)


def test_a_point_is_out_if_all_its_corners_are_as_high_as_this():
    """Halfway between vertices at 1 and 5 mm, 2 mm too low: 3 + 2 = 5 mm; the third has no part in it."""
    height = torch.tensor([[0.001, 0.005, 0.03]])
    even = one_contact([0.5, 0.5, 0.0], 0.002).even_heights(height)
    np.testing.assert_allclose(even, [[0.005, 0.005, 0]], atol=1e-9)


def test_cloth_outside_has_no_contacts_nor_has_what_has_no_surface():
    assert contacts_of(posed(ball(1)), Mesh(ball(1, 0.2).vertices, ball(1).faces)) is None
    assert contacts_of(HalfSpace(0.5), ONE) is None


PAIRS = {"both coarse": (1, 1), "a dense body": (3, 1), "dense cloth": (1, 3)}


def around(name: str):
    """Cloth about a ball, whose vertices end up outside and whose edges and faces do not; (N, 3) turned a little."""
    of_body, of_cloth = PAIRS[name]
    body, cloth = ball(of_body), ball(of_cloth)
    mesh = Mesh(Rotation.from_rotvec([0.3, 0.2, -0.4]).apply(cloth.vertices), cloth.faces)
    return body, mesh


@pytest.mark.parametrize("name", PAIRS)
def test_after_the_clean_up_nothing_crosses_and_no_vertex_is_inside(name):
    body, cloth = around(name)
    sdf, topology = posed(body), Topology(cloth)
    assert crossings(tensor(cloth.vertices), cloth, body) > 20
    result = lift_clear(tensor(cloth.vertices), sdf, topology, clearance_m=1e-3, rounds=10)
    assert crossings(result.vertices, cloth, body) == 0
    assert sdf.query(result.vertices).distance.min() >= 1e-3
    assert result.rounds_between <= 6
    lengths = topology.difference(result.vertices).norm(dim=-1) / topology.rest_lengths.float()
    assert lengths.max() < 1.25


def test_a_batch_equals_its_frames_and_rigid_motion_changes_nothing():
    body, cloth = around("both coarse")
    topology = Topology(cloth)
    turn = Rotation.from_rotvec([0.5, -0.2, 0.9])
    scaled = np.stack([cloth.vertices, 1.02 * cloth.vertices, 0.5 + turn.apply(cloth.vertices)])
    bodies = np.stack([body.vertices, body.vertices, 0.5 + turn.apply(body.vertices)])
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(bodies)
    together = lift_clear(
        torch.from_numpy(scaled).float(), sdf, topology, clearance_m=1e-3, rounds=10
    ).vertices
    for k, (points, pose) in enumerate(zip(scaled, bodies, strict=True)):
        sdf.update(pose[None])
        alone = lift_clear(torch.from_numpy(points).float()[None], sdf, topology, clearance_m=1e-3, rounds=10)
        assert torch.equal(together[k], alone.vertices[0])
    back = turn.inv().apply(together[2].double().numpy() - 0.5)
    np.testing.assert_allclose(back, together[0], atol=2e-5)


def test_cloth_that_crosses_nothing_stays_bit_for_bit():
    body, cloth = around("both coarse")
    points = tensor(1.3 * np.asarray(cloth.vertices))
    result = lift_clear(points, posed(body), Topology(cloth), clearance_m=1e-3, rounds=10)
    assert torch.equal(result.vertices, points)
    assert (result.rounds, result.rounds_between) == (0, 0)


@pytest.mark.parametrize("bound", ["exact", "half of it", "none"])
def test_crossing_edges_are_counted_as_by_a_search_of_all(bound):
    """Whatever less than the distance is known of the vertices; each frame by itself."""
    body, cloth = around("dense cloth")
    sdf, topology = posed(body), Topology(cloth)
    shrunk = [np.asarray(cloth.vertices) * factor for factor in (2.0, 0.99, 1.0)]
    sdf.update(np.stack([np.asarray(body.vertices)] * 3))
    points = torch.cat([tensor(each) for each in shrunk])
    distance = sdf.query(points).distance
    known = {"exact": distance, "half of it": torch.where(distance > 0, 0.5 * distance, distance)}
    known["none"] = distance.clamp(max=0)
    frames = torch.tensor([0, 2])
    found = SurfaceContact(sdf, topology, CPU).body_crossings(points, known[bound], frames)
    assert found.tolist() == [crossings(points[[frame]], cloth, body) for frame in (0, 2)]
    assert found[1] > 10


def test_pinned_vertices_stay_though_their_faces_cross():
    fixed = torch.tensor([True, False, True])
    result = lift_clear(
        tensor(ONE.vertices), posed(SPIKE), Topology(ONE), clearance_m=1e-3, rounds=10, fixed=fixed
    )
    assert torch.equal(result.vertices[:, fixed], tensor(ONE.vertices)[:, fixed])
    assert crossings(result.vertices, ONE, SPIKE) == 0


def test_edges_keep_out_of_a_garment_beneath_too():
    inner, cloth = around("both coarse")
    surface = OuterSurface(inner.faces, len(inner.vertices), offset_m=1e-3)
    both = Obstacles([surface])
    both.update(np.asarray(inner.vertices)[None])
    result = lift_clear(tensor(cloth.vertices), both, Topology(cloth), clearance_m=1e-3, rounds=10)
    assert crossings(result.vertices, cloth, inner) == 0


def test_the_solvers_planes_are_raised_where_cloth_between_vertices_is_inside():
    body, cloth = around("both coarse")
    sdf, topology, points = posed(body), Topology(cloth), tensor(cloth.vertices)
    depths = []
    for surface in (None, SurfaceContact(sdf, topology, CPU)):
        energy = Energy(topology, {}, points, torch.ones(1, topology.n_vertices))
        contact = Contact(sdf, points, margin_m=0.0, every_steps=4, surface=surface)
        for _ in range(2):  # the first query asks about vertices alone
            contact.update_planes(points)
        step = ConstrainedStep(energy, None, contact)
        step.vertices.copy_(points)
        step.length.zero_()
        step.advance()
        left = SurfaceContact(sdf, topology, CPU).find(energy.vertices, sdf.query(energy.vertices).distance)
        depths.append(0.0 if left is None else left.depth.sum().item())
    assert depths[1] < 0.5 * depths[0]


def test_normals_at_some_vertices_are_those_of_all():
    """Of two poses; the last vertex is in no face, and one face has no area."""
    body = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    count = len(body.vertices) + 1
    faces = np.concatenate([body.faces, [[0, 0, 1]]])
    still = np.concatenate([body.vertices, [[9.0, 9.0, 9.0]]])
    poses = torch.from_numpy(np.stack([still, still * [1.0, 2.0, 0.5] + 0.3]).astype(np.float32))
    mesh = MeshBvh(faces, count, device="cpu", name="body")
    mesh.update(poses)
    frames, vertices = torch.tensor([1, 0, 1, 0, 0]), torch.tensor([0, 0, 7, 12, count - 1])
    found = _Surface(mesh)._normals(frames, vertices)
    expected = VertexNormals(faces, count)(poses)[frames, vertices]
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)
    assert found[-1].abs().max() == 0
    assert not torch.allclose(found[0], found[1], atol=0.01)
