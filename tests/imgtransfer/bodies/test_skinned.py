"""Posing, blending and interpolating on an arm of two bones, where everything is known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.skinned import BonePoses, SkinnedBody, skinned

QUARTER = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()  # x goes to y


class Arm(SkinnedBody):
    """An upper arm from the origin to (1, 0, 0) and a forearm beyond; every SMPL joint is one of the two."""

    bone_parents = (-1, 0)
    bone_heads = np.array([[0.0, 0, 0], [1, 0, 0]])
    joint_bones = np.arange(22) % 2
    leg_length = 1.0

    def bone_poses(self, poses, trans, *, leg_length=None):
        """The first two joints' global rotations, the root where the path says."""
        turned = Rotation.from_rotvec(poses[:, :2].reshape(-1, 3)).as_matrix().reshape(len(poses), 2, 3, 3)
        return BonePoses(turned, trans * (self.leg_length / leg_length if leg_length else 1.0))


@pytest.fixture
def arm():
    rest = np.array([[0.0, 0, 0], [0.5, 0.1, 0], [1, 0, 0], [1.5, 0, 0.1], [2, 0, 0]], np.float32)
    weights = np.array([[1, 0], [1, 0], [0.5, 0.5], [0, 1], [0, 1]], np.float32)
    return Arm(rest, np.array([[0, 1, 2], [2, 3, 4]], np.int32), weights)


def bones(*rotations, root=(0, 0, 0)):
    return BonePoses(np.stack(rotations)[None], np.array([root], float))


def test_a_bent_elbow_by_hand(arm):
    transforms = arm.transforms(bones(np.eye(3), QUARTER))
    wanted = [[0, 0, 0], [0.5, 0.1, 0], [1, 0, 0], [1, 0.5, 0.1], [1, 1, 0]]
    np.testing.assert_allclose(arm.vertices(transforms)[0], wanted, atol=1e-7)


def test_a_forearm_follows_its_parent(arm):
    transforms = arm.transforms(bones(QUARTER, np.eye(3), root=(5, 0, 0)))  # the forearm's own axes stay
    wanted = [[5, 0, 0], [4.9, 0.5, 0], [5, 1, 0], [5.5, 1, 0.1], [6, 1, 0]]
    np.testing.assert_allclose(arm.vertices(transforms)[0], wanted, atol=1e-6)


def test_the_rest_pose_leaves_everything_where_it_is(arm):
    transforms = arm.transforms(arm.rest_pose())
    np.testing.assert_allclose(transforms[0], [np.eye(3, 4)] * 2, atol=1e-15)
    assert np.array_equal(arm.vertices(transforms)[0], arm.rest)


def test_posing_gives_skin_and_joints_and_scales_the_path(arm):
    poses = np.zeros((2, 22, 3))
    poses[1, 1, 2] = np.pi / 2
    body = arm.pose(poses, np.array([[0, 0, 0], [0, 0.8, 0]]), leg_length=0.8)
    assert (body.vertices.dtype, body.vertices.shape) == (np.float32, (2, 5, 3))
    np.testing.assert_allclose(
        body.vertices[1, 4], [1, 2, 0], atol=1e-6
    )  # one unit up by the path, one by the bend
    np.testing.assert_allclose(body.joints[1, [0, 1]], [[0, 1, 0], [1, 1, 0]], atol=1e-9)


def test_skinning_is_a_plain_loop_and_takes_a_shape_for_every_frame():
    random = np.random.default_rng(0)
    transforms, weights = random.normal(size=(3, 4, 3, 4)), random.dirichlet(np.ones(4), 6)
    rests = random.normal(size=(3, 6, 3))
    for rest in (rests[0], rests):
        result = skinned(transforms, weights, rest)
        assert result.dtype == np.float32
        for frame, point in np.ndindex(3, 6):
            at = np.append(rest[point] if rest.ndim == 2 else rest[frame, point], 1)
            wanted = sum(weights[point, k] * transforms[frame, k] @ at for k in range(4))
            np.testing.assert_allclose(result[frame, point], wanted, atol=1e-5)


def test_a_rigid_motion_of_all_bones_is_one_of_the_skin(arm):
    turn = Rotation.from_rotvec([0.3, -1, 0.2]).as_matrix()
    before = arm.vertices(arm.transforms(bones(np.eye(3), QUARTER)))
    after = arm.vertices(arm.transforms(bones(turn, turn @ QUARTER, root=(1, 2, 3))))
    np.testing.assert_allclose(after, before @ turn.T + [1, 2, 3], atol=1e-6)


def test_weights_near_a_vertex_are_its_own_and_between_vertices_their_mean(arm):
    at_vertex = arm.weights_near(np.array([[1.5, 0, 0.1]]))
    np.testing.assert_allclose(at_vertex, [[0, 1]], atol=1e-6)
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], np.float32)
    even = replace(arm, rest=square, blend_weights=np.array([[1, 0], [1, 0], [0, 1], [1, 0]], np.float32))
    np.testing.assert_allclose(even.weights_near(np.array([[0.0, 0, 0.7]])), [[0.75, 0.25]], atol=1e-7)
    # Nearer to the upper two by 1/d²: 1/0.25 + 1/4.25 each, and the lower ones' 1/2.25 + 1/... by a plain loop.
    point = np.array([0.5, 0.9, 0.0])
    closeness = np.array([1 / ((point - vertex) ** 2).sum() for vertex in square])
    wanted = closeness[[0, 1, 3]].sum() / closeness.sum()
    np.testing.assert_allclose(even.weights_near(point[None]), [[wanted, 1 - wanted]], atol=1e-6)


def test_points_on_several_vertices_at_one_place_are_finite(arm):
    same = replace(arm, rest=np.zeros((5, 3), np.float32))
    weights = same.weights_near(np.zeros((1, 3)))
    assert weights.sum() == pytest.approx(1)
    assert np.isfinite(weights).all()


def test_no_points_have_no_weights(arm):
    assert arm.weights_near(np.zeros((0, 3))).shape == (0, 2)


def test_interpolation_turns_each_bone_against_its_parent(arm):
    start = bones(np.eye(3), np.eye(3))
    end = bones(QUARTER, QUARTER @ QUARTER, root=(4, 0, 0))
    middle = arm.interpolate(start, end, 0.5)
    eighth = Rotation.from_rotvec([0, 0, np.pi / 4]).as_matrix()
    np.testing.assert_allclose(middle.rotations[0], [eighth, eighth @ eighth], atol=1e-12)
    np.testing.assert_allclose(middle.root, [[2, 0, 0]])


def test_every_frame_has_its_own_place_between(arm):
    start = BonePoses(np.stack([np.eye(3)] * 4).reshape(2, 2, 3, 3), np.zeros((2, 3)))
    end = BonePoses(np.stack([QUARTER] * 4).reshape(2, 2, 3, 3), np.ones((2, 3)))
    mixed = arm.interpolate(start, end, np.array([[0.25], [1.0]]))
    np.testing.assert_allclose(mixed.root, [[0.25] * 3, [1] * 3])
    np.testing.assert_allclose(mixed.rotations[1], end.rotations[1], atol=1e-12)
    turned = Rotation.from_matrix(mixed.rotations[0]).magnitude()
    np.testing.assert_allclose(turned, np.pi / 8, atol=1e-12)
