"""A mesh in poses: what of it and of points is accepted, and that each pose's points meet that pose."""

import numpy as np
import pytest
import torch

from fusion import parallel
from fusion.obstacles import sdf_kernels
from fusion.obstacles.bvh import MeshBvh
from render import InputError
from tests.helpers.example_meshes import two_triangles

SQUARE = two_triangles()  # z = 0, facing +z
FACES = SQUARE.faces


def heights(mesh, points, *, count=None):
    """(P,) signed distances of points (..., 3), where all are within a metre."""
    flat = mesh.points(points)
    packed = torch.full((len(flat), 7), -9.0)
    mesh.launch(
        sdf_kernels.normal, flat, [1.0], [packed], count=len(flat) if count is None else count, by_warp=True
    )
    return packed[:, 0]


def raised(*offsets):
    """(T, 4, 3): the square at these heights."""
    return SQUARE.vertices + np.multiply.outer(offsets, [0.0, 0, 1])[:, None]


def posed(*offsets, batched=True):
    mesh = MeshBvh(FACES, 4, device="cpu", name="body")
    poses = raised(*offsets)
    mesh.update(poses if batched else poses[0])
    return mesh


POINTS = torch.tensor([[0.1, 0.2, 0.3], [-0.2, 0.1, -0.4]])


def test_a_single_pose_takes_points_of_any_leading_axes():
    mesh = posed(0.1, batched=False)
    for shape in ((3,), (1, 3), (2, 1, 3), (2, 3, 2, 3)):
        points = POINTS[0].expand(shape)
        np.testing.assert_allclose(heights(mesh, points), 0.2, atol=1e-6)


def test_each_pose_meets_its_own_points():
    mesh = posed(0.0, 0.1, -0.2)
    found = heights(mesh, POINTS.expand(3, 2, 3)).reshape(3, 2)
    np.testing.assert_allclose(found, [[0.3, -0.4], [0.2, -0.5], [0.5, -0.2]], atol=1e-6)


def test_a_pose_more_or_fewer_than_before_is_no_trouble():
    mesh = posed(0.0)
    for offsets in ((0.1, 0.2, 0.3), (0.05,), (0.25, 0.15)):
        moved = mesh.update(raised(*offsets))
        assert moved.shape == (len(offsets), 4, 3)
        found = heights(mesh, torch.zeros(len(offsets), 1, 3))
        np.testing.assert_allclose(found, -np.array(offsets), atol=1e-6)


def test_poses_are_copied_and_not_shared_with_who_gave_them():
    vertices = torch.from_numpy(SQUARE.vertices).float()
    mesh = MeshBvh(FACES, 4, device="cpu", name="body")
    mesh.update(vertices)
    vertices += 100.0
    np.testing.assert_allclose(heights(mesh, POINTS), [0.3, -0.4], atol=1e-6)


def test_faces_of_any_integers_and_vertices_of_any_floats():
    for faces, vertices in (
        (torch.from_numpy(FACES).int(), torch.from_numpy(SQUARE.vertices).half()),
        (FACES.astype(np.uint8), SQUARE.vertices.astype(np.float32)),
    ):
        mesh = MeshBvh(faces, 4, device="cpu", name="body")
        moved = mesh.update(vertices)
        assert moved.dtype == torch.float32
        assert mesh.faces.dtype == np.int64
        np.testing.assert_allclose(heights(mesh, POINTS), [0.3, -0.4], atol=1e-6)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("poses", [1, 2, 5])
def test_work_is_cut_between_poses_or_anywhere_in_a_single_one(monkeypatch, threads, poses):
    monkeypatch.setattr("fusion.obstacles.bvh._WORTH_A_THREAD", 1)
    mesh = posed(*0.01 * np.arange(poses))
    points = torch.zeros(poses, 7, 3)
    points[..., 2] = torch.arange(7 * poses).reshape(poses, 7) / 100
    token = parallel._threads.set(threads)
    try:
        found = heights(mesh, points)
    finally:
        parallel._threads.reset(token)
    want = points[..., 2] - 0.01 * torch.arange(poses)[:, None]
    np.testing.assert_allclose(found, want.ravel(), atol=1e-6)


def test_no_threads_write_nothing():
    assert heights(posed(0.0), POINTS[None], count=0).eq(-9).all()
    assert heights(posed(0.0, 0.1), torch.zeros(2, 0, 3)).shape == (0,)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (np.zeros((3, 3)), r"inner_vertices must have shape \(4, 3\) or \(frames, 4, 3\), found \(3, 3\)"),
        (np.zeros((4, 2)), r"found \(4, 2\)"),
        (np.zeros(3), r"found \(3,\)"),
        (np.zeros((0, 4, 3)), r"found \(0, 4, 3\)"),
        (np.zeros((1, 1, 4, 3)), r"found \(1, 1, 4, 3\)"),
        (np.full((2, 4, 3), np.nan), "inner_vertices: frame 0, vertex 0 is .* not finite"),
        (np.full((4, 3), np.inf), "inner_vertices: vertex 0 is .* not finite"),
    ],
)
def test_poses_that_are_none_are_named_by_what_the_mesh_is(vertices, message):
    mesh = MeshBvh(FACES, 4, device="cpu", name="inner")
    with pytest.raises(InputError, match=message) as caught:
        mesh.update(vertices)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (torch.zeros(2, 2), r"points must have shape \(\.\.\., 3\), found \(2, 2\)"),
        (torch.tensor(0.0), r"found \(\)"),
        (torch.zeros(3, 1, 3), r"points must have shape \(2, N, 3\), one frame a body, found \(3, 1, 3\)"),
        (torch.zeros(2, 3), r"found \(2, 3\)"),
        (torch.full((2, 1, 3), torch.nan), "not finite"),
        (torch.full((2, 1, 3), 1e7), "1000 km"),
    ],
)
def test_points_that_fit_no_pose_are_named(points, message):
    with pytest.raises(InputError, match=message):
        posed(0.0, 0.1).points(points)


def test_a_mesh_without_a_pose_says_what_to_call():
    mesh = MeshBvh(FACES, 4, device="cpu", name="inner")
    with pytest.raises(InputError, match=r"no pose of the inner yet; call update\(inner_vertices\)"):
        mesh.points(POINTS)
    with pytest.raises(InputError, match=r"inner_faces: face 1 uses vertices \[0, 2, 3\]"):
        MeshBvh(FACES, 3, device="cpu", name="inner")
