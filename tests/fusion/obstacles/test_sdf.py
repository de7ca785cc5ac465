"""Signed distance against shapes whose distance is known."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
import trimesh

from fusion import BodySdf
from fusion.obstacles.sdf import is_closed
from imgtransfer.bodies.anny import load_body
from imgtransfer.motions.library import make_motion
from render import InputError
from tests.helpers.paths import EXTERNAL

SIGNS = ("checked", "winding", "normal")


def sphere(radius: float = 0.5, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def sdf_of(mesh: trimesh.Trimesh, sign: str = "checked") -> BodySdf:
    sdf = BodySdf(mesh.faces, len(mesh.vertices), sign=sign)
    sdf.update(mesh.vertices)
    return sdf


def brute_winding_numbers(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(P, 3), (G, 3, 3) -> (P,) float64: the solid angles of all faces, added up."""
    found = []
    for chunk in np.array_split(points.astype(np.float64), max(1, len(points) // 50)):
        a, b, c = (triangles[None, :, corner] - chunk[:, None] for corner in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        found.append(np.arctan2(volume, rest).sum(-1) / (2 * np.pi))
    return np.concatenate(found)


def near_surface(triangles: np.ndarray, count: int, spread: float) -> np.ndarray:
    """(count, 3) float32 points scattered about a mesh, half of them inside."""
    random = np.random.default_rng(0)
    chosen = triangles[random.integers(len(triangles), size=count)]
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    on = (chosen * random.dirichlet(np.ones(3), count)[..., None]).sum(1)
    return (on + normals * random.normal(0, spread, (count, 1))).astype(np.float32)


def coil() -> trimesh.Trimesh:
    """A closed sausage whose end runs through its beginning: one mesh that overlaps itself, as a body does."""
    x, y, z = trimesh.creation.icosphere(subdivisions=4).vertices.T
    turn, reach = 1.5 * np.pi * y, 0.3 + 0.08 * x
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.vertices = np.stack([reach * np.cos(turn), 0.08 * z + 0.002 * turn, reach * np.sin(turn)], axis=1)
    mesh.invert()
    return mesh


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


@pytest.mark.parametrize("sign", ["checked", "winding"])
def test_a_point_between_overlapping_limbs_is_inside(sign):
    """A thin rod sunk into a sphere, as an arm pressed into the trunk: the closest surface is the rod, which
    faces the point, yet the point is inside the body."""
    rod = trimesh.creation.cylinder(radius=0.05, height=0.6, sections=32)
    body = trimesh.util.concatenate([sphere(), rod])
    point = torch.tensor([[0.07, 0.01, 0.02]])
    assert sdf_of(body, "normal").distance(point).item() > 0
    assert sdf_of(body, sign).distance(point).item() < 0


def test_where_limbs_overlap_the_way_leads_out_of_the_whole():
    rod = trimesh.creation.cylinder(radius=0.05, height=0.6, sections=32)
    body = trimesh.util.concatenate([sphere(), rod])
    points = torch.tensor([[0.07, 0.01, 0.02], [0.3, 0.0, 0.0], [0.02, 0.0, 0.1], [0.0, 0.01, 0.32]])
    found = sdf_of(body).query(points)
    depth = 0.5 - points.norm(dim=-1)
    assert (-found.distance >= depth - 6e-4).all()  # no way is shorter than the shortest
    assert (-found.distance <= 1.05 * depth).all()
    assert (found.direction * points / points.norm(dim=-1, keepdim=True)).sum(-1).min() > 0.9
    out = points + (1e-3 - found.distance)[:, None] * found.direction
    torch.testing.assert_close(found.closest.norm(dim=-1), torch.full((4,), 0.5), atol=1e-3, rtol=0)
    assert (sdf_of(body).distance(out) > 0).all()


@pytest.mark.parametrize(("kind", "frame"), [("squat", 29), ("run", 74), ("punch", 44), ("random", 60)])
def test_signs_on_the_posed_body_are_those_of_a_brute_force_winding_number(kind, frame):
    body, motion = load_body(), make_motion(kind, seed=1)
    bones = body.bone_poses(motion.poses, motion.trans, leg_length=motion.leg_length)
    pose = body.vertices(body.transforms(bones))[frame]
    triangles = pose[body.faces].astype(np.float64)
    points = near_surface(triangles, 400, spread=0.02)
    inside = brute_winding_numbers(points, triangles) > 0.5
    for sign in ("checked", "winding"):
        sdf = BodySdf(body.faces, len(pose), sign=sign)
        sdf.update(pose)
        assert ((sdf.query(torch.from_numpy(points)).distance < 0).numpy() != inside).sum() == 0


@pytest.mark.skipif(not (EXTERNAL / "unpack.py").is_file(), reason=f"no external clips at {EXTERNAL}")
@pytest.mark.parametrize(("clip", "frame"), [("tshirt_vb1_415", 50), ("tshirt_cmu_02_10_a", 0)])
def test_signs_on_a_posed_smpl_body_are_those_of_a_brute_force_winding_number(tmp_path, clip, frame):
    (tmp_path / "packed").mkdir()
    (tmp_path / "packed" / f"{clip}.npz").symlink_to(EXTERNAL / f"{clip}.npz")
    unpack = [sys.executable, str(EXTERNAL / "unpack.py"), f"{tmp_path}/npz", f"{tmp_path}/packed"]
    subprocess.run(unpack, check=True, capture_output=True)
    arrays = np.load(tmp_path / "npz" / f"{clip}.npz")
    pose, faces = arrays["body_vertices"][frame], arrays["body_faces"]
    triangles = pose[faces].astype(np.float64)
    points = np.concatenate(
        [near_surface(triangles, 250, spread=0.015), arrays["garment_vertices"][frame][::50]]
    )
    inside = brute_winding_numbers(points, triangles) > 0.5
    sdf = BodySdf(faces, len(pose))
    sdf.update(pose)
    assert sdf.sign == "checked"
    assert ((sdf.query(torch.from_numpy(points)).distance < 0).numpy() != inside).sum() == 0


def test_signs_on_a_mesh_that_runs_through_itself():
    mesh = coil()
    points = near_surface(mesh.triangles, 1500, spread=0.04)
    number = brute_winding_numbers(points, mesh.triangles)
    assert (number > 1.5).sum() > 20
    found = {
        sign: (sdf_of(mesh, sign).query(torch.from_numpy(points)).distance < 0).numpy() for sign in SIGNS
    }
    assert (found["normal"] != (number > 0.5)).sum() > 10
    assert (found["checked"] != (number > 0.5)).sum() == 0
    assert (found["winding"] != (number > 0.5)).sum() == 0


def test_signs_at_a_spike_sharper_than_a_right_angle():
    """Either face of a sharp edge may be the closest, and one of them tells the wrong side."""
    spike = trimesh.Trimesh([[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0], [0.005, 0.005, 0.3]], process=False)
    spike.faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    points = np.random.default_rng(0).uniform([-0.02, -0.02, -0.1], [0.03, 0.03, 0.4], (3000, 3))
    inside = brute_winding_numbers(points.astype(np.float32), spike.triangles) > 0.5
    assert inside.sum() > 20
    found = sdf_of(spike).query(torch.from_numpy(points))
    assert ((found.distance < 0).numpy() != inside).sum() == 0
    away = (torch.from_numpy(points).float() - found.closest) * torch.where(found.distance < 0, -1, 1)[
        :, None
    ]
    assert ((away * found.direction).sum(-1) >= -1e-6).all()


def test_points_may_each_say_whose_frame_they_are_of():
    frames = np.stack([sphere().vertices, sphere(0.4).vertices, sphere(0.3).vertices])
    sdf = BodySdf(sphere().faces, frames.shape[1])
    sdf.update(frames)
    points = torch.tensor([[0.6, 0, 0], [0.6, 0, 0], [0.1, 0, 0], [0.0, 0.6, 0]])
    found = sdf.query(points, torch.tensor([2, 0, 1, 2]))
    np.testing.assert_allclose(found.distance, [0.3, 0.1, -0.3, 0.3], atol=2e-3)
    with pytest.raises(InputError, match=r"points must have shape \(2, 3\), one a frame, found \(4, 3\)"):
        sdf.query(points, torch.tensor([0, 1]))


def test_points_known_to_be_outside_get_the_same_answer():
    sdf = sdf_of(coil())
    points = torch.from_numpy(near_surface(coil().triangles, 400, 0.03))
    whole = sdf.query(points)
    outside = whole.distance > 0
    found = sdf.query(points, outside=outside)
    for name in ("distance", "direction", "closest"):
        assert torch.equal(getattr(found, name), getattr(whole, name))


def test_doubts_are_settled_by_rays_where_they_agree():
    """No mesh with winding numbers, which is slow to move, is made for a body that overlaps itself."""
    sdf = sdf_of(coil())
    points = near_surface(coil().triangles, 2000, 0.03)
    found = sdf.query(torch.from_numpy(points)).distance
    inside = brute_winding_numbers(points, coil().triangles) > 0.5
    assert ((found < 0).numpy() == inside).all()
    assert sdf._doubted is None


def test_beyond_the_band_the_distance_is_the_band_without_a_direction():
    points = torch.randn(500, 3, generator=torch.Generator().manual_seed(0)) * 0.6
    exact = sdf_of(sphere()).query(points)
    banded = BodySdf(sphere().faces, len(sphere().vertices), band_m=0.1)
    banded.update(sphere().vertices)
    found = banded.query(points.requires_grad_())
    near = exact.distance < 0.1
    assert 50 < near.sum() < 450
    assert (exact.distance < -0.1).sum() > 20  # deep inside nothing is cut off
    for name in ("distance", "direction", "closest"):
        torch.testing.assert_close(getattr(found, name)[near], getattr(exact, name)[near])
    assert (found.distance[~near] == 0.1).all()
    assert (found.direction[~near] == 0).all()
    assert torch.equal(found.closest[~near], points.detach()[~near])
    banded.distance(points).sum().backward()
    assert torch.equal(points.grad, found.direction)


def test_refitting_to_a_very_different_pose_answers_as_a_fresh_search_structure():
    mesh = sphere()
    far = mesh.vertices[:, [2, 0, 1]] * [1.5, 0.3, 1.0]
    points = torch.randn(300, 3, generator=torch.Generator().manual_seed(0)) * 0.5
    moved, fresh = sdf_of(mesh), BodySdf(mesh.faces, len(mesh.vertices))
    moved.update(far)
    fresh.update(far)
    torch.testing.assert_close(moved.query(points).distance, fresh.query(points).distance)


def test_winding_number_survives_a_hole():
    mesh = sphere()
    hole = mesh.triangles_center[:, 1] < 0.495  # the eyes and mouth are cut out of the body mesh like this
    sdf = BodySdf(mesh.faces[hole], len(mesh.vertices))
    sdf.update(mesh.vertices)
    points = torch.tensor([[0.0, 0.3, 0.0], [0.0, 0.7, 0.0], [0.45, 0.0, 0.0], [0.55, 0.0, 0.0]])
    assert (sdf.distance(points) < 0).tolist() == [True, False, True, False]


@pytest.mark.parametrize(
    ("closed", "faces"), [(True, [0, 1, 2, 3]), (False, [0, 1, 2]), (False, [0, 1, 2, 3, 3])]
)
def test_a_closed_mesh_passes_every_edge_both_ways(closed, faces):
    tetrahedron = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    assert is_closed(tetrahedron[faces]) is closed
    assert is_closed(np.concatenate([tetrahedron, tetrahedron + 4])) is True
    assert is_closed(np.concatenate([tetrahedron[:3], tetrahedron[3:, ::-1]])) is False


def test_a_mesh_with_holes_or_turned_faces_gets_the_winding_number():
    mesh = sphere()
    turned = mesh.faces.copy()
    turned[::50] = turned[::50, ::-1]
    points = torch.randn(500, 3, generator=torch.Generator().manual_seed(0)) * 0.5
    clear = (points.norm(dim=-1) - 0.5).abs() > 0.05  # close to a turned face the number is anything
    for faces in (turned, mesh.faces[100:]):
        sdf = BodySdf(faces, len(mesh.vertices))
        assert sdf.sign == "winding"
        sdf.update(mesh.vertices)
        assert torch.equal((sdf.distance(points) < 0)[clear], (points.norm(dim=-1) < 0.5)[clear])
    assert BodySdf(mesh.faces, len(mesh.vertices)).sign == "checked"


def test_a_body_inside_out_is_refused():
    mesh = sphere()
    sdf = BodySdf(mesh.faces[:, ::-1], len(mesh.vertices))
    with pytest.raises(InputError, match="clockwise seen from outside; reverse"):
        sdf.update(mesh.vertices)


def test_vertices_in_no_face_do_no_harm():
    mesh = sphere()
    points = torch.randn(100, 3, generator=torch.Generator().manual_seed(0))
    loose = BodySdf(mesh.faces, len(mesh.vertices) + 2)
    loose.update(np.vstack([mesh.vertices, [[0.1, 0.1, 0.1], [9.0, 9.0, 9.0]]]))
    torch.testing.assert_close(loose.distance(points), sdf_of(mesh).distance(points))


def test_faces_without_area_do_no_harm():
    mesh = sphere()
    points = torch.randn(100, 3, generator=torch.Generator().manual_seed(0))
    flat = BodySdf(np.vstack([mesh.faces, [[5, 5, 9], [7, 7, 7]]]), len(mesh.vertices))
    assert flat.sign == "checked"
    flat.update(mesh.vertices)
    torch.testing.assert_close(flat.distance(points), sdf_of(mesh).distance(points))


def test_a_thousand_updates_leave_no_memory_behind():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    sdf = BodySdf(mesh.faces, len(mesh.vertices))
    poses = np.stack([mesh.vertices] * 3).astype(np.float32)

    def updates(count: int) -> None:
        for number in range(count):
            frames = 1 + 2 * (number % 2)  # two search structures are thrown away every other time
            sdf.update(poses[:frames])
            sdf.query(torch.zeros(frames, 4, 3))

    updates(100)
    before = resident_bytes()
    updates(1000)
    assert resident_bytes() - before < 20e6  # leaking them would take 100 MB


def resident_bytes() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


def test_queries_may_run_in_many_threads():
    rod = trimesh.creation.cylinder(radius=0.05, height=0.6, sections=32)
    body = trimesh.util.concatenate([sphere(), rod])
    points = torch.randn(16, 300, 3, generator=torch.Generator().manual_seed(0)) * 0.4
    shared = sdf_of(body)

    def own(part: torch.Tensor) -> torch.Tensor:
        return sdf_of(body).query(part).distance

    want = [sdf_of(body).query(part).distance for part in points]
    with ThreadPoolExecutor(8) as pool:
        for ask in (lambda part: shared.query(part).distance, own):
            for found, wanted in zip(pool.map(ask, points), want, strict=True):
                assert torch.equal(found, wanted)


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
    with pytest.raises(InputError, match="band_m is 0"):
        BodySdf(mesh.faces, len(mesh.vertices), band_m=0.0)
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
