import itertools

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from imgtransfer.deformers.common.bone_skinning import BoneSkinning, bones_about
from imgtransfer.deformers.common.rigid_bones import Bones, first_bones, fit_cluster, moved, refine_bones
from imgtransfer.deformers.common.rotations import nearest_rotation
from imgtransfer.deformers.common.ssdr import decompose, far_points
from imgtransfer.deformers.common.ssdr_weights import onto_simplex, simplex_minimum, solve_weights


def planted(frames: int = 40) -> tuple[np.ndarray, np.ndarray, Bones, np.ndarray]:
    """A strip of cloth moved by three bones, which share the vertices between them: rest, weights, bones, positions."""
    random = np.random.default_rng(3)
    x, y = np.meshgrid(np.linspace(0, 0.9, 19), np.linspace(0, 0.3, 7), indexing="ij")
    rest = np.stack([x, y, 0.05 * np.sin(7 * x + 5 * y)], -1).reshape(-1, 3)
    second = np.clip((rest[:, 0] - 0.25) / 0.1, 0, 1) * (1 - np.clip((rest[:, 0] - 0.55) / 0.1, 0, 1))
    third = np.clip((rest[:, 0] - 0.55) / 0.1, 0, 1)
    weights = np.stack([1 - second - third, second, third], 1).clip(0, 1)
    turns = Rotation.from_rotvec(random.normal(0, 0.5, (3 * frames, 3))).as_matrix().reshape(3, frames, 3, 3)
    bones = Bones(turns, random.normal(0, 0.2, (3, frames, 3)))
    return rest, weights, bones, moved(rest, weights, bones)


def test_planted_bones_and_weights_are_recovered():
    rest, weights, _, moves = planted()
    got = decompose(rest, moves.swapaxes(0, 1), bones=3, influences=2, rounds=20)
    order = min(itertools.permutations(range(3)), key=lambda p: np.abs(got.weights[:, p] - weights).sum())
    assert got.rms[-1] < 1e-4  # metres; the strip moves by decimetres
    np.testing.assert_allclose(got.weights[:, order], weights, atol=0.01)
    again = moved(rest, got.weights, got.bones)
    np.testing.assert_allclose(again, moves, atol=1e-3)


def test_the_error_never_rises_and_weights_are_sparse_on_the_simplex():
    random = np.random.default_rng(0)
    rest, _, _, moves = planted(frames=12)
    got = decompose(
        rest, (moves + random.normal(0, 0.02, moves.shape)).swapaxes(0, 1), bones=6, influences=3, rounds=5
    )
    assert all(after <= before * (1 + 1e-9) for before, after in itertools.pairwise(got.rms))
    assert (got.weights >= 0).all()
    assert (got.weights > 0).sum(axis=1).max() <= 3
    np.testing.assert_allclose(got.weights.sum(axis=1), 1, atol=1e-12)


def test_more_bones_than_vertices_are_no_more_than_vertices():
    rest = np.eye(3)
    got = decompose(rest, np.stack([rest, rest + 1]), bones=10, influences=4, rounds=1)
    assert len(got.bones) == 3
    assert got.rms[-1] < 1e-9


def test_a_mesh_that_stays_moves_by_nothing():
    rest = planted()[0]
    got = decompose(rest, np.stack([rest] * 3), bones=4, influences=4, rounds=2)
    assert got.rms[-1] < 1e-9


def test_a_turned_triangle_gives_its_turn():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rest = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])
    moves = (rest @ quarter.T + [5, 6, 7])[:, None]
    turn, shift = fit_cluster(rest, moves, np.ones(3, bool))
    np.testing.assert_allclose(turn[0], quarter, atol=1e-12)
    np.testing.assert_allclose(shift[0], [5, 6, 7], atol=1e-12)


def test_nearest_rotation_of_a_mirror_is_no_mirror():
    assert np.linalg.det(nearest_rotation(np.diag([3.0, 2.0, -1.0]))) == pytest.approx(1)


def test_errors_of_single_bones_are_those_of_a_plain_loop():
    rest, _, bones, moves = planted(frames=4)
    want = [
        sum(np.sum((bones.rotation[v, t] @ u + bones.translation[v, t] - moves[i, t]) ** 2) for t in range(4))
        for i, u in enumerate(rest)
        for v in range(3)
    ]
    np.testing.assert_allclose(bones.errors(rest, moves).ravel(), want, atol=1e-9)


def test_bones_fit_exactly_what_they_made_and_planted_weights_stay():
    rest, weights, bones, moves = planted(frames=5)
    start = first_bones(rest, moves, weights)
    for _ in range(60):
        start = refine_bones(rest, moves, weights, start)
    np.testing.assert_allclose(moved(rest, weights, start), moves, atol=2e-3)
    solved = solve_weights(rest, moves, bones, np.full_like(weights, 1 / 3), 2)
    np.testing.assert_allclose(solved, weights, atol=1e-4)


def test_the_simplex_by_hand():
    got = onto_simplex(np.array([[2.0, 0, 0], [0.5, 0.5, 0.5], [0.4, 0.8, -1]]))
    np.testing.assert_allclose(got, [[1, 0, 0], [1 / 3, 1 / 3, 1 / 3], [0.3, 0.7, 0]], atol=1e-12)


def test_the_minimum_on_the_simplex_by_hand_and_against_a_solver():
    by_hand = simplex_minimum(np.array([[[1.0, 0], [0, 3]], [[1, 2], [2, 5]]]))  # of 3/4, and on the edge
    np.testing.assert_allclose(by_hand, [[0.75, 0.25], [1, 0]], atol=1e-7)
    factors = np.random.default_rng(1).normal(size=(5, 4, 4))
    quadratic = factors @ factors.swapaxes(1, 2)
    for matrix, got in zip(quadratic, simplex_minimum(quadratic), strict=True):
        want = minimize(
            lambda w, h=matrix: w @ h @ w,
            np.full(4, 0.25),
            bounds=[(0, 1)] * 4,
            constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
        )
        assert got @ matrix @ got <= want.fun + 1e-9


def test_far_points_of_a_line():
    assert far_points(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]]), 3).tolist() == [3, 0, 2]


def test_skinning_about_where_bones_rest_is_skinning():
    rest, weights, bones, moves = planted(frames=3)
    skinning = BoneSkinning(torch.from_numpy(weights)).double()
    places = skinning.places(torch.from_numpy(rest))
    turn, offset = bones_about(bones, places.numpy())
    got = skinning(turn.double(), offset.double(), places, torch.from_numpy(rest))
    np.testing.assert_allclose(got, moves.swapaxes(0, 1), atol=1e-6)


def test_a_networks_numbers_are_bones_about_their_mean():
    rest, weights, bones, _ = planted(frames=30)
    skinning = BoneSkinning(torch.from_numpy(weights).float())
    turn, offset = bones_about(bones, skinning.places(torch.from_numpy(rest).float()).numpy())
    skinning.standardise(turn, offset)
    mean_turn, mean_offset = skinning.bones(torch.zeros(3, 6))
    np.testing.assert_allclose(mean_offset, offset.mean(0), atol=1e-6)
    np.testing.assert_allclose(mean_turn @ mean_turn.mT, np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-5)
    _, moved_offset = skinning.bones(torch.ones(3, 6))
    deviation = (offset - offset.mean(0)).square().mean((0, 2)).sqrt()
    np.testing.assert_allclose(moved_offset - mean_offset, deviation[:, None].expand(3, 3), atol=1e-6)
