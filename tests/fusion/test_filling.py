"""Vertices that were not read, from those that were: solved by hand, densely, and on layers of cloth."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fusion.filling import Filling
from fusion.filling_system import nearest_rotations
from render import Mesh
from tests.helpers.fusion_examples import AROUND, tube, wrinkled
from tests.helpers.layers import bent, heights, layered

TUBE = tube()
EXACT = 1e-7  # metres: what makes rotations defined everywhere turns them by as many radians
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
MOVES = {"rest": (np.eye(3), np.zeros(3)), "rigid": (TURN, np.array([0.3, -1.0, 2.0]))}


def strip(count=5):
    """Two rows of `count` vertices, 1 m apart in x and y: number i at (i, 0, 0), count + i at (i, 1, 0)."""
    x = np.arange(count, dtype=float)
    vertices = np.concatenate([np.stack([x, 0 * x + y, 0 * x], 1) for y in (0, 1)])
    i = np.arange(count - 1)
    faces = np.concatenate(
        [np.stack([i, i + 1, count + i], 1), np.stack([i + 1, count + i + 1, count + i], 1)]
    )
    return Mesh(vertices, faces)


def filled(mesh, seen, vertices, dtype=torch.float64):
    """One frame, the vertices that are not seen spoilt first."""
    spoilt = np.where(np.asarray(seen)[:, None], vertices, 1e3)
    result = Filling(mesh, np.asarray(seen))(
        torch.from_numpy(spoilt).to(dtype)[None], torch.tensor(np.asarray(seen))[None]
    )
    return result[0].numpy()


def hidden(mesh, part, seed=0):
    """(N,) bool, seen: all but a strip along the tube's side and a part of the others, by chance."""
    chance = np.random.default_rng(seed).random(len(mesh.vertices)) > part
    return chance & (np.abs(mesh.vertices[:, 0]) < 0.12)


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_shape_at_rest_and_rigid_motions_of_it_are_filled_exactly(move, dtype):
    turn, shift = MOVES[move]
    truth = TUBE.vertices @ turn.T + shift
    for part in (0.0, 0.1, 0.6):
        found = filled(TUBE, hidden(TUBE, part), truth, dtype)
        np.testing.assert_allclose(found, truth, atol=EXACT if dtype == torch.float64 else 1e-6)


def test_seen_vertices_stay_as_they_are_and_what_unseen_ones_held_makes_no_difference():
    seen, truth = hidden(TUBE, 0.1), wrinkled(TUBE, 1).numpy()[0]
    found = filled(TUBE, seen, truth, torch.float32)
    np.testing.assert_array_equal(found[seen], truth[seen])
    assert np.abs(found[~seen] - truth[~seen]).max() < 0.02


def test_a_strip_bent_by_a_right_angle_goes_round_the_corner_as_solved_by_hand():
    """Seen to x = 1 and from x = 3: unturned there and turned by 90 degrees here, so by 45 at x = 2 between them.

    The two unseen vertices have edges of length 1 to x = 1 and x = 3 and to each other, one a diagonal of √2 to x = 1
    and one to x = 3. All keep the direction that the mean of both ends' rotations gives.
    """
    mesh = strip()
    quarter = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    bent = mesh.vertices.copy()
    beyond = mesh.vertices[:, 0] >= 3
    bent[beyond] = (mesh.vertices[beyond] - [3, 0, 0]) @ quarter.T + [2.0, 0, 1.0]
    seen = mesh.vertices[:, 0] != 2
    found = filled(mesh, seen, bent)
    # Where x goes before and after the corner: ((1 + √½) / 2, 0, √½ / 2), and that with x and z swapped. From x = 1 and
    # from x = 3 these lead to (1.854, 0, 0.354) and (1.646, 0, 0.146); the diagonals' pulls nearly cancel out.
    np.testing.assert_allclose(found[[2, 7]], [[1.75, 0, 0.25], [1.75, 1, 0.25]], atol=0.02)


def dense(mesh, seen, vertices):
    """The plain way: loops over the edges, dense systems, singular values."""
    n, rest = len(seen), mesh.vertices
    length = np.linalg.norm(rest[mesh.edges[:, 0]] - rest[mesh.edges[:, 1]], axis=1)
    laplacian, sums = np.zeros((n, n)), np.zeros((n, 3, 3))
    for (i, j), metres in zip(mesh.edges, length, strict=True):
        stiffness = length.mean() / metres
        laplacian[[i, j], [i, j]] += stiffness
        laplacian[[i, j], [j, i]] -= stiffness
        if seen[i] and seen[j]:
            outer = stiffness * np.outer(vertices[i] - vertices[j], rest[i] - rest[j])
            sums[i] += outer
            sums[j] += outer
    u, s = np.flatnonzero(~seen), np.flatnonzero(seen)
    inverse = np.linalg.inv(laplacian[np.ix_(u, u)])
    sums[u] = np.einsum("ab,bij->aij", -inverse @ laplacian[np.ix_(u, s)], sums[s])
    near, smooth = (laplacian != 0) & ~(seen[:, None] & seen), sums.copy()
    for i in range(n):
        others = [j for j in range(n) if near[i, j] and j != i]
        weights = -laplacian[i, others]
        if others:
            smooth[i] += 0.1 * np.tensordot(weights, sums[others], 1) / weights.sum()
    smooth += 1e-5 * smooth[near.any(1)].mean(0)  # the rest of what makes it regular is smaller
    turns = []
    for matrix in smooth:
        left, _, right = np.linalg.svd(matrix)
        turns.append(left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right)
    right_side = np.zeros((n, 3))
    for i, j in mesh.edges:
        pull = laplacian[i, j] * (turns[i] + turns[j]) / 2 @ (rest[i] - rest[j])
        right_side[i] -= pull
        right_side[j] += pull
    found = vertices.copy()
    found[u] = inverse @ (right_side[u] - laplacian[np.ix_(u, s)] @ vertices[s])
    return found


def test_the_sparse_systems_say_what_dense_ones_do():
    mesh = tube(0.15, 0.2)
    seen, truth = hidden(mesh, 0.2), wrinkled(mesh, 2).numpy()[1].astype(float)
    np.testing.assert_allclose(filled(mesh, seen, truth), dense(mesh, seen, truth), atol=EXACT)


def test_a_batch_is_filled_as_its_frames_alone_whichever_vertices_each_has():
    usual, truth = hidden(TUBE, 0.0), wrinkled(TUBE, 4).double()
    seen = np.stack([usual, usual & hidden(TUBE, 0.1), usual, hidden(TUBE, 0.3, seed=1)])
    filling = Filling(TUBE, usual)
    together = filling(truth, torch.from_numpy(seen))
    for frame in range(4):
        alone = filling(truth[[frame]], torch.from_numpy(seen[[frame]]))[0]
        torch.testing.assert_close(together[frame], alone, rtol=0, atol=1e-9)
    anew = torch.from_numpy(filled(TUBE, seen[3], truth[3].numpy()))
    torch.testing.assert_close(together[3], anew, rtol=0, atol=1e-9)


def test_all_seen_and_no_frames_are_returned():
    truth, everything = wrinkled(TUBE, 2), torch.ones(2, len(TUBE.vertices), dtype=torch.bool)
    filling = Filling(TUBE, np.ones(len(TUBE.vertices), bool))
    assert torch.equal(filling(truth, everything), truth)
    assert filling(truth[:0], everything[:0]).shape == (0, len(TUBE.vertices), 3)


def test_readings_that_err_alike_at_rest_and_in_a_frame_do_no_harm():
    """Seen vertices are read 3 mm beside their places, along a direction that turns with the garment."""
    turn, shift = MOVES["rigid"]
    seen = hidden(TUBE, 0.1)
    aside = TUBE.vertices + 0.003 * np.random.default_rng(0).standard_normal(TUBE.vertices.shape)
    filling = Filling(TUBE, seen, aside)
    found = filling(torch.from_numpy(aside @ turn.T + shift)[None], torch.from_numpy(seen)[None])[0].numpy()
    np.testing.assert_allclose(found[~seen], (TUBE.vertices @ turn.T + shift)[~seen], atol=EXACT)


# --- degenerate meshes and readings


def test_one_seen_vertex_carries_the_shape_unturned():
    mesh, seen = strip(), np.arange(10) == 3
    moved = mesh.vertices + np.array([0.5, -2.0, 1.0])
    np.testing.assert_allclose(filled(mesh, seen, moved), moved, atol=1e-7)


def test_seen_vertices_on_a_line_turn_the_rest_with_it_as_little_as_they_can():
    """One row of the strip, turned about z: nothing tells whether the other row also turned about the first."""
    mesh, seen = strip(), np.arange(10) < 5
    turned = mesh.vertices @ Rotation.from_euler("z", 50, degrees=True).as_matrix().T
    np.testing.assert_allclose(filled(mesh, seen, turned), turned, atol=1e-6)


def test_a_vertex_that_no_face_uses_goes_with_the_nearest_cloth():
    mesh = Mesh(np.concatenate([TUBE.vertices, [[0.0, 0.0, 0.17]]]), TUBE.faces)
    seen = np.append(hidden(TUBE, 0.0), False)
    turn, shift = MOVES["rigid"]
    moved = mesh.vertices @ turn.T + shift
    np.testing.assert_allclose(filled(mesh, seen, moved), moved, atol=EXACT)


def test_edges_of_no_length_and_doubled_faces_do_no_harm():
    vertices = TUBE.vertices.copy()
    vertices[AROUND * 5 + 8] = vertices[AROUND * 5 + 9]  # on the unseen side
    faces = np.concatenate([TUBE.faces, TUBE.faces[:7], [[0, 5 * AROUND + 3, 9 * AROUND + 16]]])
    mesh = Mesh(vertices, faces)
    turn, shift = MOVES["rigid"]
    moved = vertices @ turn.T + shift
    np.testing.assert_allclose(filled(mesh, hidden(mesh, 0.1), moved), moved, atol=EXACT)


def test_an_inside_out_reading_leaves_finite_vertices():
    mirrored = TUBE.vertices * [1, 1, -1]
    assert np.isfinite(filled(TUBE, hidden(TUBE, 0.1), mirrored)).all()
    assert np.isfinite(filled(TUBE, hidden(TUBE, 0.1), 0 * mirrored)).all()


def test_a_piece_that_loses_its_last_reading_in_one_frame_goes_with_the_cloth_next_to_it():
    mesh, copies = layered(0.006)
    seen = hidden(mesh, 0.0)
    lost = seen & ~copies
    frames = torch.from_numpy(mesh.vertices).repeat(2, 1, 1) + 0.5
    found = Filling(mesh, seen)(frames, torch.from_numpy(np.stack([seen, lost])))
    torch.testing.assert_close(found, frames, rtol=0, atol=EXACT)


# --- rotations


def test_rotations_are_the_nearest_as_singular_values_give_them():
    matrices = torch.randn(500, 3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    left, _, right = torch.linalg.svd(matrices)
    side = torch.linalg.det(left @ right)
    want = left @ torch.diag_embed(torch.stack([torch.ones(500), torch.ones(500), side], -1).double()) @ right
    found = nearest_rotations(matrices)
    torch.testing.assert_close(found[side > 0], want[side > 0], rtol=0, atol=1e-6)
    orthogonal = found @ found.mT
    torch.testing.assert_close(orthogonal, torch.eye(3).double().expand(500, 3, 3), rtol=0, atol=1e-9)
    assert (torch.linalg.det(found) > 0).all()


@pytest.mark.parametrize("rank", [2, 3])
def test_rotations_of_what_is_flat_are_found_exactly(rank):
    points = torch.randn(50, 3, rank, generator=torch.Generator().manual_seed(rank), dtype=torch.float64)
    turn = torch.from_numpy(TURN)
    found = nearest_rotations(turn @ (points @ points.mT))
    torch.testing.assert_close(found, turn.expand(50, 3, 3), rtol=0, atol=1e-6)


def test_nothing_and_a_line_have_a_rotation():
    line = torch.zeros(2, 3, 3, dtype=torch.float64)
    line[1, 1, 0] = 4.0  # x goes to y
    none, turned = nearest_rotations(line)
    torch.testing.assert_close(none, torch.eye(3).double())
    want = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=torch.float64)
    torch.testing.assert_close(turned, want, rtol=0, atol=1e-6)


# --- layers


@pytest.mark.parametrize("flip", [False, True])
def test_a_lining_that_no_view_sees_stays_inside_of_the_cloth(flip):
    mesh, copies = layered(-0.005, flip)
    outer = np.arange(len(TUBE.vertices)).reshape(-1, AROUND)[3:14].ravel()
    moved = bent(mesh.vertices)
    found = filled(mesh, ~copies & (np.abs(mesh.vertices[:, 0]) < 0.12), moved)
    height = heights(found, outer, copies)
    assert height.min() > -0.008
    assert height.max() < -0.003


@pytest.mark.parametrize(
    "columns", [slice(0, 9), slice(4, 13)], ids=["in front", "at the side, little of it seen"]
)
def test_cloth_under_a_pocket_stays_under_it(columns):
    """Six millimetres outside the tube; what lies beneath is not seen, nor are the tube's sides."""
    mesh, copies = layered(0.006, columns=columns, rows=slice(4, 12))
    outer = np.arange(len(TUBE.vertices)).reshape(-1, AROUND)[4:12, columns].ravel()
    beneath = np.isin(np.arange(len(mesh.vertices)), outer)
    seen = ~beneath & (np.abs(mesh.vertices[:, 0]) < 0.12)
    assert (seen & copies).any()
    waves = wrinkled(TUBE, 1).numpy()[0].astype(float)
    radial = waves * [1, 0, 1] / np.hypot(waves[:, :1], waves[:, 2:])
    moved = np.concatenate([waves, (waves + 0.006 * radial)[outer]])
    height = heights(filled(mesh, seen, moved), outer, copies)
    assert height.min() > 0.002
    assert height.max() < 0.010


def test_layers_that_a_solver_pushed_away_are_put_back_and_nothing_else_is():
    mesh, copies = layered(-0.005)
    seen = ~copies & (np.abs(mesh.vertices[:, 0]) < 0.12)
    filling = Filling(mesh, seen)
    np.testing.assert_array_equal(filling.layered, copies)
    turn, shift = MOVES["rigid"]
    moved = torch.from_numpy(mesh.vertices @ turn.T + shift)[None]
    pushed = moved + 0.02 * torch.from_numpy(copies)[:, None]
    torch.testing.assert_close(filling.put_back(pushed), moved, rtol=0, atol=EXACT)
    single = torch.from_numpy(TUBE.vertices)[None]
    assert Filling(TUBE, hidden(TUBE, 0.1)).put_back(single) is single
