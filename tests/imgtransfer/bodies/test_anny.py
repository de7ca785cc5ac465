import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.build import SKIN_VERTICES, _owner
from imgtransfer.bodies.retarget import BONES
from imgtransfer.bodies.rotations import about, between, twist
from imgtransfer.bodies.smpl import INDEX, PARENTS, global_rotations, local_poses
from imgtransfer.motions.library import make_motion


@pytest.fixture(scope="module")
def body():
    return load_body()


def posed(body, poses, trans=(0.0, 0.9, 0.0)):
    poses = np.asarray(poses, float).reshape(-1, 22, 3)
    bones = body.bone_poses(poses, np.tile(trans, (len(poses), 1)))
    transforms = body.transforms(bones)
    return body.vertices(transforms), transforms, bones


def head(body, transforms, name):
    return transforms[0, :, :, :3] @ body.heads[name] + transforms[0, :, :, 3]


def bone(body, transforms, name):
    return head(body, transforms, name)[list(BONES).index(name)]


def test_the_rest_mesh_is_closed_and_wound_outwards(body):
    halves = body.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    directed = {tuple(half) for half in halves.tolist()}
    assert len(directed) == len(halves)  # no edge twice in one direction
    assert all((b, a) in directed for a, b in directed)  # every edge has its opposite: watertight, consistent
    corners = body.rest[body.faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(
        0.0498, rel=0.01
    )  # of the full skin; positive: counter-clockwise from outside
    assert len(body.rest) - len(directed) // 2 + len(body.faces) == 2  # one piece without handles


def test_the_mesh_is_light_and_even(body):
    corners = body.rest[body.faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    assert 2500 < len(body.rest) < 4500
    assert lengths.max() < 0.04
    assert lengths.min() > 0.01


def test_it_stands_upright_faces_z_and_has_its_left_at_positive_x(body):
    assert np.ptp(body.rest[:, 1]) == pytest.approx(1.626, abs=0.01)  # metres tall
    joints = body.joints_rest
    assert joints[INDEX["head"], 1] > joints[INDEX["pelvis"], 1] > joints[INDEX["left_ankle"], 1]
    assert joints[INDEX["left_wrist"], 0] > 0.3 > -0.3 > joints[INDEX["right_wrist"], 0]
    assert joints[INDEX["left_foot"], 2] > joints[INDEX["left_ankle"], 2] + 0.1  # toes in front of the ankle
    assert body.parents.tolist() == list(PARENTS)


def test_weights_are_convex(body):
    assert body.blend_weights.min() >= 0
    np.testing.assert_allclose(body.blend_weights.sum(axis=1), 1, atol=1e-6)


def test_the_rest_pose_leaves_the_mesh_where_it_is(body):
    transforms = body.transforms(body.rest_pose())
    np.testing.assert_allclose(body.vertices(transforms)[0], body.rest, atol=1e-6)


def test_skinning_equals_a_plain_loop(body):
    vertices, transforms, _ = posed(body, np.random.default_rng(0).normal(0, 0.3, (2, 22, 3)))
    for vertex in (0, 700, 2000):
        expected = np.zeros(3)
        for k, weight in enumerate(body.blend_weights[vertex]):
            expected += weight * (transforms[1, k, :, :3] @ body.rest[vertex] + transforms[1, k, :, 3])
        np.testing.assert_allclose(vertices[1, vertex], expected, atol=1e-6)


def test_the_root_stands_where_the_clip_convention_says(body):
    _, transforms, bones = posed(body, np.random.default_rng(1).normal(0, 0.4, (1, 22, 3)))
    root = transforms[0, 0, :, :3] @ body.joints_rest[0] + transforms[0, 0, :, 3]
    np.testing.assert_allclose(root, bones.root[0], atol=1e-12)
    # The middle of the hip joints is 9 cm below SMPL's pelvis joint, along the turned pelvis.
    rotation = bones.rotations[0, 0]
    middle = (body.heads["upperleg01.L"] + body.heads["upperleg01.R"]) / 2 - body.heads["root"]
    np.testing.assert_allclose(root + rotation @ middle, [0, 0.9, 0] + rotation @ [0, -0.09, 0], atol=1e-12)


def test_a_turn_of_the_root_turns_the_body_rigidly(body):
    poses = np.random.default_rng(2).normal(0, 0.2, (1, 22, 3))
    turned = poses.copy()
    turn = Rotation.from_rotvec([0.3, 1.0, -0.2])
    turned[0, 0] = (turn * Rotation.from_rotvec(poses[0, 0])).as_rotvec()
    plain, rigid = posed(body, poses, trans=np.zeros(3))[0][0], posed(body, turned, trans=np.zeros(3))[0][0]
    np.testing.assert_allclose(rigid, plain @ turn.as_matrix().T, atol=2e-6)


def test_the_zero_pose_is_the_t_pose(body):
    _, transforms, _ = posed(body, np.zeros((1, 22, 3)))
    wrist, shoulder = bone(body, transforms, "wrist.L"), bone(body, transforms, "upperarm01.L")
    arm = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    assert arm[0] > 0.98
    assert abs(arm[1]) < 0.05
    knee, ankle = bone(body, transforms, "lowerleg01.R"), bone(body, transforms, "foot.R")
    assert (ankle - knee)[1] / np.linalg.norm(ankle - knee) < -0.98


@pytest.mark.parametrize(("joint", "vector", "tip"), [
    ("left_elbow", [0, -np.pi / 2, 0], "wrist.L"),
    ("right_elbow", [0, np.pi / 2, 0], "wrist.R"),
])  # fmt: skip
def test_a_bent_elbow_points_the_forearm_forward(body, joint, vector, tip):
    poses = np.zeros((1, 22, 3))
    poses[0, INDEX[joint]] = vector
    _, transforms, _ = posed(body, poses)
    forearm = bone(body, transforms, tip) - bone(body, transforms, f"lowerarm01.{tip[-1]}")
    assert forearm[2] / np.linalg.norm(forearm) > 0.99


def test_a_bent_knee_moves_the_foot_backward(body):
    poses = np.zeros((1, 22, 3))
    poses[0, INDEX["left_knee"], 0] = np.pi / 2
    _, transforms, _ = posed(body, poses)
    shin = bone(body, transforms, "foot.L") - bone(body, transforms, "lowerleg01.L")
    assert shin[2] / np.linalg.norm(shin) < -0.98


def test_interpolation_meets_its_ends_and_keeps_bones_together(body):
    _, _, bones = posed(body, np.random.default_rng(3).normal(0, 0.4, (1, 22, 3)))
    rest = body.rest_pose()
    for share, wanted in ((0.0, rest), (1.0, bones)):
        np.testing.assert_allclose(
            body.interpolate(rest, bones, share).rotations, wanted.rotations, atol=1e-9
        )
    halfway = body.transforms(body.interpolate(rest, bones, 0.5))[0]
    elbow = body.heads["lowerarm01.L"]
    names = list(BONES)
    upper, lower = halfway[names.index("upperarm02.L")], halfway[names.index("lowerarm01.L")]
    np.testing.assert_allclose(
        upper[:, :3] @ elbow + upper[:, 3], lower[:, :3] @ elbow + lower[:, 3], atol=1e-9
    )


def test_local_and_global_rotations_are_inverse():
    poses = np.random.default_rng(4).normal(0, 0.5, (3, 22, 3))
    np.testing.assert_allclose(local_poses(global_rotations(poses)), poses, atol=1e-12)
    # Hand value: 90 degrees about y at the pelvis and again at the left hip are 180 together.
    poses = np.zeros((1, 22, 3))
    poses[0, [0, 1], 1] = np.pi / 2
    np.testing.assert_allclose(global_rotations(poses)[0, 4], np.diag([-1.0, 1.0, -1.0]), atol=1e-12)


def test_twist_is_unwrapped_and_between_goes_halfway():
    axis = np.array([0.0, 0.0, 1.0])
    angles = np.linspace(0, 2 * np.pi + 1, 30)
    np.testing.assert_allclose(twist(about(axis, angles), axis), angles, atol=1e-9)
    half = between(about(axis, np.array([0.2])), about(axis, np.array([1.0])), 0.5)
    np.testing.assert_allclose(half, about(axis, np.array([0.6])), atol=1e-12)


@pytest.mark.long
def test_the_stored_body_lies_on_annys_skin_and_moves_with_it(body):
    """Anny's first load on a machine takes about 1.5 minutes; `scripts/test --long` installs it."""
    import anny  # noqa: PLC0415
    import gpytoolbox  # noqa: PLC0415

    to_z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    model = anny.Anny()
    rest = model(pose_parameters=None)
    skin = rest["rest_vertices"][0, :SKIN_VERTICES].numpy() @ to_z_up
    faces = model.faces.numpy()
    faces = faces[(faces < SKIN_VERTICES).all(axis=1)].astype(np.int32)
    squared, face, corners = gpytoolbox.squared_distance(body.rest.astype(float), skin, F=faces, use_cpp=True)
    off = np.sqrt(squared)
    assert np.percentile(off, 90) < 0.001  # metres; only hands, feet and ears are simplified
    assert off.max() < 0.012

    motion = make_motion("reach", seed=4, seconds=1)
    bones = body.bone_poses(motion.poses[-1:], motion.trans[-1:])
    turned = bones.rotations[0][
        [
            list(BONES).index(_owner(model.bone_labels, model.bone_parents, i))
            for i in range(len(model.bone_labels))
        ]
    ]
    parameters = np.tile(np.eye(4), (1, len(turned), 1, 1))
    parameters[0, :, :3, :3] = to_z_up @ turned @ to_z_up.T @ rest["rest_bone_poses"][0, :, :3, :3].numpy()
    parameters[0, 0, :3, 3] = to_z_up @ bones.root[0]
    full = model(pose_parameters=torch.from_numpy(parameters), pose_parameterization="world-orient")
    full = full["vertices"][0, :SKIN_VERTICES].numpy() @ to_z_up
    carried = np.einsum("bk,bkc->bc", corners, full[faces[face]])
    error = np.linalg.norm(body.vertices(body.transforms(bones))[0] - carried, axis=-1)[off < 0.001]
    assert np.percentile(error, 99) < 0.002
    assert error.max() < 0.006
