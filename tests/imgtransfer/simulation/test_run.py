"""Real simulations, kept short; the first on a machine also compiles Newton's kernels (45 s on one core)."""

import numpy as np
import pytest
import torch

from fusion import BodySdf
from imgtransfer.cli.main import main
from imgtransfer.data.store import DataSet
from imgtransfer.motions.library import make_motion
from imgtransfer.running import Pool, Serial
from imgtransfer.simulation.config import GateConfig
from imgtransfer.simulation.planning.job import simulate
from imgtransfer.simulation.planning.plan import plan
from imgtransfer.simulation.run import Rejected, simulate_clip
from render import InputError
from tests.helpers.simulations import short

CONFIG = """
garment: {edge_length: 0.035}
solver: {min_substeps: 6, max_substeps: 6, iterations: 4, settle_seconds: 0.3, warm_up_seconds: 0.2}
clips:
  - {motion: twist, seed: 1, seconds: 1, split: test}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of one clip of 10 frames, by the command."""
    folder = tmp_path_factory.mktemp("simulate")
    (folder / "short.yaml").write_text(CONFIG)
    command = ["simulate", str(folder / "short.yaml"), "--frames", "10", "--out", str(folder / "set.zarr")]
    assert main(command) == 0
    return folder, command


def test_the_command_writes_a_clip_that_holds_together(made):
    clip = DataSet.open(made[0] / "set.zarr").read("tshirt/twist_s1")
    assert clip.n_frames == 10
    assert DataSet.open(made[0] / "set.zarr").split("tshirt/twist_s1") == "test"
    assert "6 to 6 substeps" in clip.info["simulator"]
    assert clip.info["licence"] == "CC0-1.0"
    # The body follows from its weights and transforms up to the rounding of positions to 2**-16 m.
    rest = np.concatenate([clip.body.rest, np.ones((len(clip.body.rest), 1))], axis=1)
    blended = np.einsum(
        "bk,tkij->tbij", clip.skeleton.blend_weights, clip.skeleton.joint_transforms.astype(float)
    )
    np.testing.assert_allclose(np.einsum("tbij,bj->tbi", blended, rest), clip.body.vertices, atol=3e-5)
    # The root joint stands at joints_rest[0] + trans.
    root = (
        clip.skeleton.joint_transforms[:, 0, :, :3] @ clip.skeleton.joints_rest[0]
        + clip.skeleton.joint_transforms[:, 0, :, 3]
    )
    np.testing.assert_allclose(root, clip.skeleton.joints_rest[0] + clip.skeleton.trans, atol=1e-6)
    for positions in (clip.garment.vertices, clip.body.vertices, clip.template.vertices, clip.body.rest):
        assert np.array_equal(positions * 2**16, np.rint(positions * 2**16))


def test_the_shirt_stays_on_hangs_and_moves(made):
    clip = DataSet.open(made[0] / "set.zarr").read("tshirt/twist_s1")
    start, end = clip.template.faces[:, 0], clip.template.faces[:, 1]

    def lengths(vertices):
        return np.linalg.norm(vertices[..., start, :] - vertices[..., end, :], axis=-1)

    stretch = lengths(clip.garment.vertices) / lengths(clip.template.vertices)
    assert 0.9 < np.percentile(stretch, 1) < np.percentile(stretch, 99) < 1.3
    moved = np.linalg.norm(clip.garment.vertices - clip.template.vertices, axis=-1)
    assert 0.002 < np.median(moved) < 0.1
    # The template hangs on the resting body, outside it.
    sdf = BodySdf(clip.body.faces, len(clip.body.rest))
    sdf.update(clip.body.rest)
    assert sdf.distance(torch.from_numpy(clip.template.vertices)).min() > 0


def test_a_second_run_keeps_what_stands(made, capsys):
    folder, command = made
    file = folder / "set.zarr" / "tshirt" / "twist_s1" / "zarr.json"
    before = file.stat().st_mtime_ns
    assert main(command) == 0
    assert file.stat().st_mtime_ns == before
    assert "1 of 1 clips stand, 0 rejected" in capsys.readouterr().out


def test_a_clip_that_fails_its_gates_is_rejected_with_the_reason(tmp_path):
    config = short(
        gates=GateConfig(p99_stretch=0.5),
        clips=({"motion": "walk", "seconds": 0.2}, {"motion": "run", "seconds": 0.2}),
    )
    with pytest.raises(
        Rejected, match=r"walk_s0: rejected after two attempts: p99_stretch is .* at most 0.5 allowed"
    ):
        simulate_clip(make_motion("walk", seconds=0.2), config)
    with pytest.raises(InputError, match="every clip was rejected"):
        simulate(plan(config), tmp_path / "set.zarr", progress=False)
    data = DataSet.open(tmp_path / "set.zarr")
    assert data.names() == []
    assert "p99_stretch" in data.rejected()["tshirt/run_s0"]["reason"]


def test_a_drawn_garment_that_cannot_be_made_is_left_out_and_one_that_was_named_is_a_failure(tmp_path):
    coarse = {"ease": 0.01, "edge_length": 0.09}  # as wide as the sleeves
    clips = {"clips": ({"motion": "walk", "seconds": 0.2},)}
    drawn = short(garments=({"kind": "drawn", "draws": 1} | coarse,), **clips)
    with pytest.raises(InputError, match="every clip was rejected"):
        simulate(plan(drawn), tmp_path / "set.zarr", progress=False)
    listed = DataSet.open(tmp_path / "set.zarr").rejected()
    assert listed["tshirt-01/walk_s0"]["reason"].startswith(
        "tshirt-01/walk_s0: left out: tshirt: the sizes {'edge_length': 0.09, 'ease': 0.01} give a surface with "
    )
    with pytest.raises(InputError, match=r"tshirt: the sizes"):
        simulate(plan(short(garments=(coarse,), **clips)), tmp_path / "other.zarr", progress=False)


def test_two_processes_give_the_same_as_one(tmp_path):
    config = short(clips=({"motion": "walk", "seconds": 0.2}, {"motion": "turn", "seconds": 0.2}))
    for name, executor in (("one", Serial()), ("two", Pool(2))):
        assert simulate(plan(config), tmp_path / name, executor=executor, progress=False) == {}
    one, two = DataSet.open(tmp_path / "one"), DataSet.open(tmp_path / "two")
    assert one.names() == two.names() == ["tshirt/turn_s0", "tshirt/walk_s0"]
    for name in one.names():
        assert np.array_equal(one.read(name).garment.vertices, two.read(name).garment.vertices)
