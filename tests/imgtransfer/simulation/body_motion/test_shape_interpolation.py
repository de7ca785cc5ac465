"""The way of a body from its rest pose to the first frame."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.simulation.body_motion.shape_interpolation import ShapeInterpolation
from render import Mesh

BODY = load_body()
REST = BODY.rest.astype(np.float64)
EDGES = Mesh(REST, BODY.faces).edges
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


def posed(**degrees):
    """The body with joints turned by axis-angle in degrees."""
    poses = np.zeros((1, 22, 3))
    for joint, turn in degrees.items():
        poses[0, JOINTS.index(joint)] = np.radians(turn)
    bones = BODY.bone_poses(poses, np.zeros((1, 3)))
    return BODY.vertices(BODY.transforms(bones))[0].astype(np.float64)


def lengths(vertices):
    return np.linalg.norm(vertices[EDGES[:, 1]] - vertices[EDGES[:, 0]], axis=1)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_right_angle_is_45_degrees_and_lengths_stay(axis):
    end = Rotation.from_rotvec(np.pi / 2 * axis).apply(REST) + np.array([1.0, 2.0, 3.0])
    half = ShapeInterpolation(REST, end, BODY.faces).at(0.5)
    middle = (REST.mean(axis=0) + end.mean(axis=0)) / 2  # the centroid moves on a straight line
    wanted = Rotation.from_rotvec(np.pi / 4 * axis).apply(REST - REST.mean(axis=0)) + middle
    np.testing.assert_allclose(half, wanted, atol=1e-10)
    np.testing.assert_allclose(lengths(half), lengths(REST), atol=1e-10)


def test_both_ends_are_the_given_shapes():
    end = posed(left_knee=[90, 0, 0])
    way = ShapeInterpolation(REST, end, BODY.faces)
    np.testing.assert_array_equal(way.at(0.0), REST)
    np.testing.assert_allclose(way.at(1e-9), REST, atol=1e-7)
    np.testing.assert_allclose(way.at(1.0), end, atol=1e-12)


def test_a_stretched_cube_grows_evenly():
    way = ShapeInterpolation(CUBE, 3 * CUBE, CUBE_FACES)
    np.testing.assert_allclose(way.at(0.25), 1.5 * CUBE, atol=1e-12)


@pytest.mark.parametrize("pose", [
    {"left_shoulder": [0, 0, 100]},
    {"left_hip": [-90, 0, 0], "left_knee": [100, 0, 0]},
    {"left_shoulder": [0, 0, 90], "left_elbow": [0, -140, 0]},
])  # fmt: skip
def test_limbs_keep_their_length_where_straight_lines_would_shrink_them(pose):
    end = posed(**pose)
    way = ShapeInterpolation(REST, end, BODY.faces)
    for share in (0.25, 0.5, 0.75):
        wanted = (1 - share) * lengths(REST) + share * lengths(end)
        ratio = lengths(way.at(share)) / wanted
        assert 0.93 < np.percentile(ratio, 1) < np.percentile(ratio, 99) < 1.04
        assert np.percentile(ratio, 0.1) > 0.75  # single edges in the armpit
    straight = lengths((REST + end) / 2) / ((lengths(REST) + lengths(end)) / 2)
    assert np.percentile(straight, 1) < 0.75


def test_a_raised_arm_keeps_its_length():
    shoulder, wrist = (
        int(np.linalg.norm(REST - BODY.joints_rest[JOINTS.index(joint)], axis=1).argmin())
        for joint in ("left_elbow", "left_wrist")
    )
    end = posed(left_shoulder=[0, 0, 100])

    def arm(vertices):
        return np.linalg.norm(vertices[wrist] - vertices[shoulder])

    way = ShapeInterpolation(REST, end, BODY.faces)
    for share in np.linspace(0, 1, 6):
        assert arm(way.at(share)) == pytest.approx(arm(REST), rel=0.03)
    assert arm((REST + end) / 2) < 0.75 * arm(REST)


def test_loose_pieces_single_points_and_split_seams_stay_with_the_whole():
    # A cube with a small one above it, a vertex in no triangle, and a corner that the file has twice.
    vertices = np.concatenate([CUBE, 0.1 * CUBE + np.array([0.4, 1.2, 0.4]), [[0.5, 1.1, 0.5]], CUBE[7:]])
    faces = np.concatenate([CUBE_FACES, CUBE_FACES + 8])
    faces[np.isin(faces, 7) & (np.arange(24) % 2 == 0)[:, None]] = 17
    same = np.arange(18)
    same[17] = 7
    turn = Rotation.from_rotvec([0, 0, np.radians(80)])
    way = ShapeInterpolation(vertices, turn.apply(vertices), faces, same=same)
    wanted = Rotation.from_rotvec([0, 0, np.radians(40)]).apply(vertices)
    half = way.at(0.5)
    np.testing.assert_allclose(half - half[0], wanted - wanted[0], atol=1e-9)


def test_a_triangle_without_area_does_no_harm():
    faces = np.concatenate([CUBE_FACES, [[0, 1, 1], [0, 0, 0]]])
    flat = CUBE.copy()
    flat[5] = flat[4]  # the end has a collapsed edge
    half = ShapeInterpolation(CUBE, flat, faces).at(0.5)
    assert np.isfinite(half).all()
