"""The default solver's systems, and what it makes of the parts of a problem that may be missing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion import FusionConfig, Topology
from fusion.losses import edge_length_loss
from fusion.solvers.local_global import LocalGlobalSolver
from fusion.solvers.pixel_faces import PixelFaces
from fusion.solvers.recorder import frames_last
from fusion.stages import StageProblem
from render import TemplateImager
from tests.helpers.example_meshes import two_triangles
from tests.helpers.half_space import HalfSpace

MESH = two_triangles()
TOPOLOGY = Topology(MESH)
REST = torch.from_numpy(MESH.vertices)[None]
EXACT = {"edge_tolerance": 0.0, "normal_tolerance": 0.0}


@pytest.fixture(scope="module")
def pixel_faces():
    imager = TemplateImager.build(MESH, views=("front",), size=(10, 12), backend="numpy")
    return PixelFaces.of(imager.raster, TOPOLOGY)


def solver_of(pixel_faces, *, seen=(True,) * 4, pinned=None, **options):
    return LocalGlobalSolver(
        TOPOLOGY,
        FusionConfig(**EXACT | options),
        seen=torch.tensor(seen),
        pixel_faces=pixel_faces,
        device=torch.device("cpu"),
        dtype=torch.float64,
        fixed=None if pinned is None else torch.tensor(pinned),
    )


def noisy(frames=1, scale=0.1, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return REST + scale * torch.randn(frames, 4, 3, generator=generator, dtype=torch.float64)


def test_the_edge_term_s_system_is_a_laplacian_that_bounds_its_hessian(pixel_faces):
    """Of weight 1 it is the mean's Hessian if edges resisted in all directions; at rest they do along themselves."""
    system = solver_of(pixel_faces)._edge_part(1.0).toarray()
    want = np.zeros((4, 4))
    for i, j in MESH.edges:
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            want[a, b] += sign * 2 / len(MESH.edges)
    np.testing.assert_allclose(system, want)
    hessian = torch.autograd.functional.hessian(lambda x: edge_length_loss(x, TOPOLOGY), REST[0])
    difference = np.kron(system, np.eye(3)) - hessian.reshape(12, 12).numpy()
    assert np.linalg.eigvalsh(difference).min() > -1e-9


def test_unseen_vertices_are_held_by_nothing_but_their_edges(pixel_faces):
    """The diagonal beyond the Laplacian's: twice the weight over the number seen, in m²."""
    solver = solver_of(pixel_faces, seen=(True, False, True, False), weight_displacement=0.5)
    held = np.asarray(solver._edge_hessian(np.array([True, False, True, False])).sum(1)).ravel()
    np.testing.assert_allclose(held, [5000, 0, 5000, 0], atol=1e-9)


def test_a_pinned_vertex_has_no_part_in_the_system(pixel_faces):
    """Its row solves for itself alone: what pushes it moves nothing else, and what pushes others does not move it."""
    solver = solver_of(pixel_faces, pinned=[False, True, False, False])
    push, moved = (frames_last(1, 4, 3, like=REST) for _ in range(2))
    solve = solver._edge_system.solver(push, moved, torch.ones(1, dtype=torch.int32))
    push[0, 1] = 1.0
    solve()
    assert moved[0, [0, 2, 3]].abs().max() == 0
    assert moved[0, 1].min() > 0
    push[0, 1], push[0, 0] = 0.0, 1.0
    solve()
    assert moved[0, 1].abs().max() == 0


def test_an_edge_that_is_too_long_gets_its_length_where_nothing_else_counts(pixel_faces):
    solver = solver_of(pixel_faces, weight_displacement=0.0, edge_iterations=60)
    found = solver.edge_stage(StageProblem(start=noisy(), anchor=REST))
    lengths = TOPOLOGY.difference(found.vertices).norm(dim=-1)
    torch.testing.assert_close(lengths[0], TOPOLOGY.rest_lengths, rtol=0, atol=1e-5)


def test_vertices_that_count_nothing_are_free_and_without_weights_all_count_alike(pixel_faces):
    solver = solver_of(pixel_faces, edge_iterations=8)
    problem = StageProblem(start=noisy(2), anchor=noisy(2, seed=1))
    want = solver.edge_stage(problem)
    for weights in (torch.full((4,), 0.25), torch.full((2, 4), 0.25)):
        found = solver.edge_stage(replace(problem, vertex_weights=weights.double()))
        torch.testing.assert_close(found.vertices, want.vertices, rtol=0, atol=1e-12)
    free = solver.edge_stage(replace(problem, vertex_weights=torch.zeros(4).double()))
    assert free.at(-1)["displacement_m2"].eq(0).all()
    torch.testing.assert_close(free.at(0)["edge_length_m2"], want.at(0)["edge_length_m2"])


def test_frames_are_solved_as_if_each_were_alone(pixel_faces):
    solver = solver_of(pixel_faces, edge_iterations=6)
    start, anchor = noisy(3), noisy(3, seed=1)
    together = solver.edge_stage(StageProblem(start=start, anchor=anchor))
    for frame in range(3):
        alone = solver.edge_stage(StageProblem(start=start[[frame]], anchor=anchor[[frame]]))
        torch.testing.assert_close(together.vertices[frame], alone.vertices[0], rtol=0, atol=1e-12)
    moved = solver.edge_stage(StageProblem(start=start + 5, anchor=anchor + 5))
    torch.testing.assert_close(moved.vertices, together.vertices + 5, rtol=0, atol=1e-9)


def test_no_steps_tell_the_terms_at_the_start(pixel_faces):
    start = noisy(2)
    found = solver_of(pixel_faces, edge_iterations=0).edge_stage(StageProblem(start=start, anchor=start))
    assert torch.equal(found.vertices, start)
    assert found.iterations.tolist() == [0, 0]
    assert found.history["edge_length_m2"].shape == (1, 2)
    torch.testing.assert_close(found.at(0)["edge_length_m2"], edge_length_loss(start, TOPOLOGY))


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_the_obstacle_counts_unless_its_weight_is_zero(pixel_faces, weight):
    obstacle = HalfSpace(-0.2)  # through the square, which reaches down to -0.5 m
    solver = solver_of(pixel_faces, normal_iterations=4, weight_collision=weight)
    found = solver.normal_stage(StageProblem(start=REST, anchor=REST, obstacle=obstacle))
    lowest = found.vertices[..., 1].min().item()
    if weight:
        assert lowest >= -0.2 - 1e-9
        assert found.at(0)["collision_m"].item() == pytest.approx(0.3 * 2 / 4)
    else:
        assert lowest == pytest.approx(-0.5)
        assert not obstacle.queries


def test_terms_whose_input_is_missing_are_left_out(pixel_faces):
    solver = solver_of(pixel_faces, normal_iterations=1)
    target = torch.zeros(1, len(pixel_faces.places), 3, dtype=torch.float64)
    target[..., 2] = 1.0
    common = {"normal_consistency", "edge_length_m2", "displacement_m2"}
    for given, more in (
        ({}, set()),
        ({"target": target}, {"normal_rendering"}),
        ({"obstacle": HalfSpace(-9.0)}, {"collision_m"}),
    ):
        found = solver.normal_stage(StageProblem(start=noisy(), anchor=REST, **given))
        assert set(found.history) == common | more


def test_a_square_follows_target_normals_about_the_vertical(pixel_faces):
    """Turned by 0.2 about y where edges pull little: the normals at the pixels are met, the lengths kept."""
    turn = torch.tensor([[np.cos(0.2), 0, -np.sin(0.2)], [0, 1, 0], [np.sin(0.2), 0, np.cos(0.2)]])
    target = (torch.tensor([0.0, 0, 1]).double() @ turn).expand(1, len(pixel_faces.places), 3)
    solver = solver_of(pixel_faces, normal_iterations=60, weight_displacement=0.0, weight_edge=0.01)
    found = solver.normal_stage(StageProblem(start=REST, anchor=REST, target=target.contiguous()))
    assert found.at(0)["normal_rendering"].item() == pytest.approx(2 * np.sin(0.1))
    torch.testing.assert_close(TOPOLOGY.normals(found.vertices)[0], target[0, :4], rtol=0, atol=5e-3)
