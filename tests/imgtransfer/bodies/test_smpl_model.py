"""SMPL bodies on a tiny model that is written here in the format of SMPL's files; real ones may not be passed on."""

import numpy as np
import pytest
import smplx
import torch
from pydantic import TypeAdapter

from imgtransfer.bodies.config import BodyConfig, make_body
from imgtransfer.bodies.smpl import PARENTS
from imgtransfer.bodies.smpl_model import load_smpl
from imgtransfer.motions.library import make_motion
from render import InputError

TREE = [*PARENTS, 20, 21]  # with SMPL's two hand joints


@pytest.fixture(scope="module")
def arrays():
    rng = np.random.default_rng(0)
    n = 60
    regressor = rng.random((24, n)) ** 8
    weights = rng.random((n, 24)) ** 6
    first, second, third = rng.permutation(np.arange(n)).reshape(3, -1)
    return {
        "v_template": rng.normal(0, 0.5, (n, 3)),
        "f": np.stack([first, second, third], axis=1).astype(np.uint32),
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
        "kintree_table": np.array([[2**32 - 1, *TREE[1:]], range(24)]).astype(np.uint32),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "shapedirs": rng.normal(0, 0.02, (n, 3, 10)),
        "posedirs": rng.normal(0, 0.01, (n, 3, 207)),
    }


@pytest.fixture(scope="module")
def model_file(arrays, tmp_path_factory):
    path = tmp_path_factory.mktemp("smpl") / "SMPL_NEUTRAL.npz"
    np.savez(path, **arrays)
    return path


def by_smplx(arrays, betas, poses, trans):
    struct = smplx.utils.Struct(**{**arrays, "kintree_table": arrays["kintree_table"].astype(np.int64)})
    vertex_ids = dict.fromkeys(smplx.vertex_ids.vertex_ids["smplh"], 0)
    model = smplx.SMPL("", data_struct=struct, dtype=torch.float64, vertex_ids=vertex_ids)
    full = np.concatenate([poses, np.zeros((len(poses), 2, 3))], axis=1).reshape(len(poses), -1)
    out = model(
        betas=torch.tensor(betas)[None].expand(len(poses), -1),
        global_orient=torch.from_numpy(full[:, :3]),
        body_pose=torch.from_numpy(full[:, 3:]),
        transl=torch.from_numpy(trans),
    )
    return out.vertices.detach().numpy(), out.joints[:, :22].detach().numpy()


def test_it_is_the_body_of_smplx(arrays, model_file):
    rng = np.random.default_rng(1)
    betas, poses, trans = rng.normal(0, 1, 10), rng.normal(0, 0.5, (3, 22, 3)), rng.normal(0, 1, (3, 3))
    body = load_smpl(model_file, betas=betas.tolist())
    vertices, joints = by_smplx(arrays, betas, poses, trans)
    # SMPL's translation is added to the joint; this project's places the pelvis joint.
    posed = body.pose(poses, trans + body.joints_rest[0])
    np.testing.assert_allclose(posed.vertices, vertices, atol=2e-6)
    np.testing.assert_allclose(posed.joints, joints, atol=1e-6)


def test_the_rest_pose_is_the_shaped_template(arrays, model_file):
    body = load_smpl(model_file, betas=[1.0, -2.0])
    rest = arrays["v_template"] + arrays["shapedirs"][..., 0] - 2 * arrays["shapedirs"][..., 1]
    np.testing.assert_allclose(body.rest, rest, atol=1e-6)
    np.testing.assert_allclose(body.vertices(body.transforms(body.rest_pose()))[0], rest, atol=1e-6)
    assert body.parents.tolist() == list(PARENTS)


def test_a_batch_equals_its_frames_and_a_turn_is_rigid(model_file):
    body = load_smpl(model_file)
    motion = make_motion("walk", seed=1, seconds=0.2)
    posed = body.pose(motion.poses, motion.trans, leg_length=motion.leg_length)
    single = body.pose(motion.poses[3:4], motion.trans[3:4], leg_length=motion.leg_length)
    np.testing.assert_allclose(posed.vertices[3], single.vertices[0], atol=1e-6)
    poses = np.zeros((1, 22, 3))
    poses[0, 0, 1] = np.pi / 2  # +x goes to -z
    turned = body.pose(poses, np.zeros((1, 3))).vertices[0]
    x, y, z = (body.rest - body.joints_rest[0]).T
    np.testing.assert_allclose(turned, np.stack([z, y, -x], axis=1), atol=2e-6)


def test_the_path_is_scaled_to_the_legs(model_file):
    body = load_smpl(model_file)
    poses, trans = np.zeros((1, 22, 3)), np.array([[0.0, 0.8, 2.0]])
    posed = body.pose(poses, trans, leg_length=2 * body.leg_length)
    np.testing.assert_allclose(posed.joints[0, 0], trans[0] / 2, atol=1e-12)


def test_a_folder_and_betas_in_a_configuration(model_file):
    config = TypeAdapter(BodyConfig).validate_python(
        {"kind": "smpl", "path": str(model_file.parent), "betas": [0.5]}
    )
    np.testing.assert_array_equal(make_body(config).rest, load_smpl(model_file, betas=[0.5]).rest)


@pytest.mark.parametrize(("broken", "wanted"), [
    ({"posedirs": None}, "lacks posedirs"),
    ({"weights": np.zeros((60, 23))}, "weights"),
    ({"f": np.array([[0, 1, 99]])}, "face 0"),
])  # fmt: skip
def test_a_model_file_that_is_none_is_refused(arrays, tmp_path, broken, wanted):
    stored = {key: value for key, value in {**arrays, **broken}.items() if value is not None}
    np.savez(tmp_path / "m.npz", **stored)
    with pytest.raises(InputError, match=wanted):
        load_smpl(tmp_path / "m.npz")


def test_missing_files_say_what_to_get_and_where_to_put_it(tmp_path):
    with pytest.raises(InputError, match=r"register at https://smpl.is.tue.mpg.de"):
        load_smpl(tmp_path)


def test_too_many_betas_are_refused(model_file):
    with pytest.raises(InputError, match="at most 10"):
        load_smpl(model_file, betas=[0.0] * 11)


def test_an_npz_with_pickled_objects_is_not_unpickled(arrays, tmp_path):
    path = tmp_path / "m.npz"
    np.savez(path, **{**arrays, "J_regressor": np.array([{"a": 1}], dtype=object)})
    with pytest.raises(InputError):
        load_smpl(path)
