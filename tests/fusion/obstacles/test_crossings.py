"""Edges through faces: by hand, against a plain loop, laws, and what is degenerate."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fusion.obstacles import EdgeCrossings, edges_through_faces, edges_through_own_faces
from fusion.parallel import one_torch_thread
from render import InputError, Mesh
from tests.helpers.example_meshes import random_soup, sphere, tube

TRIANGLE = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACE = np.array([[0, 1, 2]])
EDGE = np.array([[0, 1]])
SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def through(edge, surface=TRIANGLE, faces=FACE):
    """Crossings of one edge, given by its ends, in one frame."""
    return edges_through_faces(np.float32([edge]), EDGE, surface[None], faces)


def plain_loop(points, edges, surface, faces, *, itself=False):
    """{(edge, face): (along, weights)} by a 3 x 3 system a pair, for pairs that are not degenerate."""
    pairs = {}
    for number, (start, end) in enumerate(edges):
        for face, corners in enumerate(faces):
            if itself and {start, end} & set(corners.tolist()):
                continue
            p, q, r = surface[corners].astype(np.float64)
            a, b = points[[start, end]].astype(np.float64)
            u, v, t = np.linalg.solve(np.stack([q - p, r - p, a - b], axis=1), a - p)
            if min(u, v, t) >= 0 and u + v <= 1 and t <= 1:
                pairs[number, face] = t, (1 - u - v, u, v)
    return pairs


def as_pairs(crossings, frame=0):
    rows = zip(
        crossings.frame, crossings.edge, crossings.face, crossings.along, crossings.weights, strict=True
    )
    return {(int(e), int(f)): (float(t), tuple(w.tolist())) for k, e, f, t, w in rows if k == frame}


def same_pairs(crossings, wanted, frame=0):
    pairs = as_pairs(crossings, frame)
    assert set(pairs) == set(wanted)
    for key, (along, weights) in wanted.items():
        assert pairs[key][0] == pytest.approx(along, abs=1e-9)
        assert pairs[key][1] == pytest.approx(weights, abs=1e-9)


def test_an_edge_through_a_triangle_by_hand():
    found = through([[0.25, 0.5, -1], [0.25, 0.5, 3]])
    assert (found.frame.tolist(), found.edge.tolist(), found.face.tolist()) == ([0], [0], [0])
    assert found.along.tolist() == [0.25]
    assert found.weights.tolist() == [[0.25, 0.25, 0.5]]
    assert found.outwards.tolist() == [True]
    assert through([[0.25, 0.5, 3], [0.25, 0.5, -1]]).outwards.tolist() == [False]
    assert found.counts().tolist() == [1]


@pytest.mark.parametrize(("edge", "wanted"), [
    ([[0.2, 0.2, 0.1], [0.2, 0.2, 1]], 0),  # above
    ([[2, 2, -1], [2, 2, 1]], 0),  # through the plane only
    ([[-0.1, 0.5, -1], [-0.1, 0.5, 1]], 0),  # beside each of the three sides
    ([[0.5, -0.1, -1], [0.5, -0.1, 1]], 0),
    ([[0.6, 0.6, -1], [0.6, 0.6, 1]], 0),
    ([[0.2, 0.2, 0], [0.2, 0.2, 1]], 0),  # an end on the face only touches
    ([[0.2, 0.2, -1], [0.2, 0.2, 0]], 0),
    ([[-1, 0.2, 0], [2, 0.2, 0]], 0),  # in the face's plane
    ([[0.2, 0.2, 1], [0.2, 0.2, 1]], 0),  # without length
    ([[0.2, 0.2, 0], [0.2, 0.2, 0]], 0),
    ([[0.5, 0.0, -1], [0.5, 0.0, 1]], 1),  # through a side, which belongs to the face
    ([[0.5, 0.5, -1], [0.5, 0.5, 1]], 1),
    ([[0.0, 0.0, -1], [0.0, 0.0, 1]], 1),  # and a corner
    ([[1.0, 0.0, 1], [1.0, 0.0, -1]], 1),
])  # fmt: skip
def test_what_passes_and_what_only_touches(edge, wanted):
    found = through(edge)
    assert found.counts().tolist() == [wanted]
    assert len(found.face) == wanted


def test_an_edge_through_the_side_between_two_faces_counts_once():
    found = through([[0.5, 0.5, -1], [0.5, 0.5, 1]], SQUARE, SQUARE_FACES)
    assert found.face.tolist() == [0, 1]
    assert found.counts().tolist() == [1]


def test_no_edge_slips_between_faces_that_share_a_side():
    """Edges through points of the sides of a closed surface, as near as float32 gets."""
    ball, random = sphere(around=12, along=7), np.random.default_rng(0)
    sides = ball.vertices[ball.edges[np.arange(2000) % len(ball.edges)]]
    along = random.uniform(size=(2000, 1))
    places = along * sides[:, 0] + (1 - along) * sides[:, 1]
    ends = np.stack([0.01 * random.normal(size=(2000, 3)), 2 * places], axis=1).reshape(1, -1, 3)
    edges = np.arange(4000).reshape(-1, 2)
    assert edges_through_faces(ends, edges, ball.vertices[None], ball.faces).counts().tolist() == [2000]


def test_faces_without_area_are_passed_by_nothing():
    line = np.float32([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]])
    assert len(through([[0.5, 0, -1], [0.5, 0, 1]], line).face) == 0
    assert len(through([[0, 0, -1], [0, 0, 1]], np.zeros((3, 3), np.float32)).face) == 0


@pytest.mark.parametrize("seed", [0, 1])
def test_pairs_are_those_of_a_plain_loop(seed):
    a, b = random_soup(seed, 40, 30), random_soup(seed + 10, 30, 40)
    points, surface = (np.float32(mesh.vertices) for mesh in (a, b))
    wanted = plain_loop(points, a.edges, surface, b.faces)
    assert len(wanted) > 50
    found = edges_through_faces(points[None], a.edges, surface[None], b.faces)
    same_pairs(found, wanted)
    order = list(zip(found.edge.tolist(), found.face.tolist(), strict=True))
    assert order == sorted(order)


def test_pairs_of_a_mesh_with_itself_are_those_of_a_plain_loop():
    mesh = random_soup(3, 50, 60)
    points = np.float32(mesh.vertices)
    wanted = plain_loop(points, mesh.edges, points, mesh.faces, itself=True)
    assert len(wanted) > 50
    same_pairs(edges_through_own_faces(points[None], mesh.edges, mesh.faces), wanted)


def test_faces_around_an_edge_do_not_count_for_it_in_its_own_mesh():
    points = np.float32([*TRIANGLE, [0.5, 0.2, -1], [0.5, 0.2, 1]])
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 3, 4]]))
    found = edges_through_own_faces(points[None], mesh.edges, mesh.faces)
    # The side opposite to the common corner passes through; the two that begin there do not.
    assert mesh.edges[found.edge.numpy()].tolist() == [[3, 4]]


FLAT = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
PAIR_FACES = np.array([[0, 1, 2], [3, 4, 5]])


def crossing_pairs(second):
    """The edges of the flat triangle and of a second one that cross the other, as pairs of vertices."""
    points = np.array(FLAT + second, float)
    mesh = Mesh(points, PAIR_FACES)
    marks = edges_through_own_faces(points[None], mesh.edges, mesh.faces).marks().numpy()
    assert marks.shape == (1, 6)
    return {tuple(edge) for edge in mesh.edges[marks[0]].tolist()}


@pytest.mark.parametrize(("second", "wanted"), [
    ([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1]], {(3, 4), (3, 5)}),  # a tip through the middle
    ([[0.2, 0.2, -1], [0.2, 0.2, 1], [3, 3, 1]], {(3, 4), (1, 2)}),  # each one's edge through the other
    ([[0.2, 0.2, 0.1], [0.3, 0.2, 1], [0.2, 0.3, 1]], set()),  # above it
    ([[2, 2, -1], [2.1, 2, 1], [2, 2.1, 1]], set()),  # through its plane only
    ([[0.6, 0.6, -1], [0.7, 0.6, 1], [0.6, 0.7, 1]], set()),  # beside each of its three sides
    ([[-0.6, 0.3, -1], [0.1, 0.3, 1], [0.0, 0.4, 1]], set()),
    ([[0.3, -0.6, -1], [0.3, 0.1, 1], [0.4, 0.0, 1]], set()),
    ([[0.2, 0.2, 0], [0.4, 0.2, 0], [0.2, 0.4, 0]], set()),  # in its plane
    ([[0.2, 0.2, 0], [0.3, 0.2, 1], [0.2, 0.3, 1]], set()),  # a tip that only touches
    ([[0.3, 0.3, -1], [0.3, 0.3, -1], [0.3, 0.3, 1]], {(3, 5), (4, 5)}),  # a triangle that is a line still pierces
])  # fmt: skip
def test_pairs_of_triangles_by_hand(second, wanted):
    assert crossing_pairs(second) == wanted


def test_each_frame_is_looked_at_by_itself_and_rigid_motion_changes_nothing():
    through, above = ([[0.2, 0.2, low], [0.3, 0.2, low + 1], [0.2, 0.3, low + 1]] for low in (-0.5, 0.5))
    mesh = Mesh(np.array(FLAT + above, float), PAIR_FACES)
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    frames = np.array([FLAT + above, FLAT + through, FLAT + above])
    frames = np.concatenate([frames, frames[1:2] @ turn.T + [3.0, -2.0, 1.0]])
    marks = edges_through_own_faces(frames, mesh.edges, mesh.faces).marks().numpy()
    assert marks.any(axis=1).tolist() == [False, True, False, True]
    assert np.array_equal(marks[1], marks[3])


def test_openings_let_pass_what_walls_do_not():
    """A closed ball half inside an open tube, through whose end it looks, and then moved into its wall."""
    sleeve, ball = tube(), sphere(0.08, around=12, along=7)
    at_end, in_wall = (ball.vertices + np.array(place) for place in ([0, 0.3, 0], [0.25, 0, 0]))
    poses, cloth = np.stack([at_end, in_wall]), np.stack([sleeve.vertices] * 2)
    assert (edges_through_faces(poses, ball.edges, cloth, sleeve.faces).counts() > 0).tolist() == [
        False,
        True,
    ]
    assert (edges_through_faces(cloth, sleeve.edges, poses, ball.faces).counts() > 0).tolist() == [
        False,
        True,
    ]


def moving(seed=5, frames=4):
    """Poses of two meshes: (T, N, 3), edges, (T, M, 3), faces."""
    a, b, random = random_soup(seed, 30, 30), random_soup(seed + 1, 30, 30), np.random.default_rng(seed)
    shifts = random.normal(scale=0.1, size=(2, frames, 1, 3))
    return a.vertices + shifts[0], a.edges, b.vertices + shifts[1], b.faces


def test_a_batch_equals_its_single_frames_also_where_it_is_cut(monkeypatch):
    points, edges, surface, faces = moving()
    batch = edges_through_faces(points, edges, surface, faces)
    assert len(set(batch.counts().tolist())) > 1
    monkeypatch.setattr("fusion.obstacles.crossings._ROWS", 2 * len(edges) + 1)
    cut = edges_through_faces(points, edges, surface, faces)
    for name in ("frame", "edge", "face", "along", "weights", "outwards"):
        assert torch.equal(getattr(batch, name), getattr(cut, name))
    for k in range(len(points)):
        single = edges_through_faces(points[k : k + 1], edges, surface[k : k + 1], faces)
        assert as_pairs(single) == as_pairs(batch, k)


def test_poses_one_after_the_other_do_not_change_the_answer():
    points, edges, surface, faces = moving()
    search = EdgeCrossings(edges, faces, surface.shape[1])
    for k in (2, 0, 3, 0):
        found = search.query(points[k : k + 1], surface[k : k + 1])
        assert as_pairs(found) == as_pairs(edges_through_faces(points, edges, surface, faces), k)


def test_rigid_motion_changes_nothing():
    points, edges, surface, faces = moving()
    turn, shift = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix(), np.array([1.0, -0.5, 0.3])
    before = edges_through_faces(points, edges, surface, faces)
    after = edges_through_faces(points @ turn.T + shift, edges, surface @ turn.T + shift, faces)
    assert torch.equal(before.marks(), after.marks())
    torch.testing.assert_close(
        after.along, before.along, rtol=0, atol=1e-4
    )  # float32 near 1 m, edges of 0.5 m
    assert torch.equal(before.outwards, after.outwards)


def test_one_thread_finds_what_two_find():
    ball, sleeve = sphere(0.2), tube()
    poses, cloth = np.stack([ball.vertices] * 2), np.stack([sleeve.vertices] * 2)
    found = edges_through_faces(poses, ball.edges, cloth, sleeve.faces)
    with one_torch_thread():
        other = edges_through_faces(poses, ball.edges, cloth, sleeve.faces)
    assert len(found.face) > 100
    assert torch.equal(found.face, other.face)
    assert torch.equal(found.edge, other.edge)


def test_no_frames_have_no_crossings():
    found = edges_through_faces(np.zeros((0, 2, 3)), EDGE, np.zeros((0, 3, 3)), FACE)
    assert found.marks().shape == (0, 1)
    assert found.counts().shape == (0,)


def test_no_edges_have_no_crossings():
    found = edges_through_faces(np.zeros((1, 2, 3)), np.zeros((0, 2), int), TRIANGLE[None], FACE)
    assert found.marks().shape == (1, 0)


def test_frames_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="2 frames of edges, 1 of faces"):
        edges_through_faces(np.zeros((2, 2, 3)), EDGE, TRIANGLE[None], FACE)
    with pytest.raises(InputError, match="not finite"):
        through([[0, 0, np.nan], [0, 0, 1]])


def test_counts_alone_are_those_of_the_places():
    mesh = tube()
    search = EdgeCrossings(mesh.edges, mesh.faces, len(mesh.vertices), itself=True)
    noise = np.random.default_rng(0).normal(0, 0.02, (3, *mesh.vertices.shape))
    noise[1] = 0
    crumpled = torch.from_numpy(mesh.vertices + noise).float()
    counts = search.counts(crumpled)
    assert counts.equal(search.query(crumpled).counts())
    assert (counts > 0).tolist() == [True, False, True]
