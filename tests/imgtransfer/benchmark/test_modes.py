"""Robustness, data sizes, variants and roll-outs of tubes; one joint turned against a body bent by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.benchmark.config import Robustness
from imgtransfer.benchmark.perturbation import turned_joint, unmoved_vertices
from imgtransfer.benchmark.probes import robustness, rollouts
from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.skinning import joint_transforms, skin
from imgtransfer.deformers.lbs.method import Lbs
from render import InputError
from tests.helpers.synthetic import tube_clip

CONFIG = """
data: [{name: tube, source: clips, train: {names: [a, b, c, d]}, test: {names: [six]}}]
methods:
  - {name: lbs}
  - {name: pose_regression, steps: 3}
pictures: 0
played: 0
fuse: false
robustness: {joints: [1], angle: 10, draws: 1}
data_sizes: [0.25, 0.5]
variants: [{method: lbs, setting: neighbours, values: [1, 8]}]
rollouts: [1, null]
"""
TURN = np.array([0.1, 0.3, -0.2])


def posed(clip: Clip) -> np.ndarray:
    """The clip's body, skinned by its poses alone."""
    own = replace(clip, skeleton=replace(clip.skeleton, joint_transforms=None))
    assert clip.skeleton.blend_weights is not None
    return skin(clip.body.rest, clip.skeleton.blend_weights, joint_transforms(own))


def test_a_turned_joint_moves_the_body_as_its_poses_say() -> None:
    clip = tube_clip(4)
    turned = turned_joint(clip, 1, TURN)
    assert turned.garment is None
    np.testing.assert_allclose(turned.body.vertices, posed(turned), atol=2e-6)
    assert clip.skeleton.poses is not None
    assert turned.skeleton.poses is not None
    np.testing.assert_array_equal(turned.skeleton.poses[:, 0], clip.skeleton.poses[:, 0])
    bend = Rotation.from_rotvec(clip.skeleton.poses[2, 1]).as_matrix()
    wanted = bend @ Rotation.from_rotvec(TURN).as_matrix()
    np.testing.assert_allclose(
        Rotation.from_rotvec(turned.skeleton.poses[2, 1]).as_matrix(), wanted, atol=1e-6
    )


def test_bones_that_are_not_the_joints_turn_alike_and_keep_their_transforms() -> None:
    clip = tube_clip(4)
    transforms = joint_transforms(clip)
    assert clip.skeleton.blend_weights is not None
    weights = np.concatenate([clip.skeleton.blend_weights, np.zeros((len(clip.body.rest), 1))], 1)
    half = weights[:, 1].copy() / 2
    weights[:, 1], weights[:, 2] = half, half  # the upper bone as two that move as one
    doubled = replace(
        clip,
        skeleton=replace(
            clip.skeleton,
            blend_weights=weights.astype(np.float32),
            joint_transforms=transforms[:, [0, 1, 1]].astype(np.float32),
        ),
    )
    turned = turned_joint(doubled, 1, TURN)
    np.testing.assert_allclose(turned.body.vertices, turned_joint(clip, 1, TURN).body.vertices, atol=2e-6)
    given = turned.skeleton.joint_transforms
    assert given is not None
    np.testing.assert_allclose(skin(clip.body.rest, weights, given), turned.body.vertices, atol=2e-6)


def test_no_turn_changes_nothing_and_the_lower_tube_stays() -> None:
    clip = tube_clip(4)
    np.testing.assert_allclose(
        turned_joint(clip, 1, np.zeros(3)).body.vertices, clip.body.vertices, atol=1e-6
    )
    still = unmoved_vertices(clip, turned_joint(clip, 1, TURN))
    low = clip.template.vertices[:, 1] < 0.3
    assert still[low].all()
    assert not still[clip.template.vertices[:, 1] > 0.6].any()


def test_skinning_moves_nothing_where_the_body_stays_and_something_elsewhere() -> None:
    clip = tube_clip(3)
    lbs = Lbs(Lbs.Config.model_validate({"neighbours": 1, "diffusion": 0}))
    lbs.fit([clip], folder=None)  # type: ignore[arg-type]  # it keeps nothing there
    moved = robustness(lbs, [clip], Robustness(joints=(1,), angle=30, draws=2), seed=0)["1"]
    assert moved["unmoved"] == pytest.approx(0, abs=1e-3)
    assert moved["all"] is not None
    assert moved["all"] > 5
    assert rollouts(lbs, [clip], (1,)) == {}


@pytest.mark.parametrize(
    ("lacking", "joint", "message"),
    [
        ({"poses": None}, 1, "needs poses, joints_rest, parents and blend_weights"),
        ({}, 2, "no joint 2; poses have 2"),
    ],
)
def test_a_body_that_cannot_be_turned_is_refused(lacking: dict[str, None], joint: int, message: str) -> None:
    clip = tube_clip(2)
    if lacking:  # transforms take the place of what then lacks
        own = joint_transforms(clip).astype(np.float32)
        clip = replace(clip, skeleton=replace(clip.skeleton, joint_transforms=own, **lacking))
    with pytest.raises(InputError, match=message):
        turned_joint(clip, joint, TURN)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("a", "b", "c", "d", "six")):
        save_clip(f"clips/{name}.npz", tube_clip(3 + number))
    Path("bench.yaml").write_text(CONFIG)
    return tmp_path


def test_every_section_has_its_table_and_stands_when_it_is_asked_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["benchmark", "bench.yaml", "--out", "out"]) == 0
    shown = capsys.readouterr().out
    modes = json.loads(Path("out/results.json").read_text())["modes"]
    sizes = {(row["method"], row["clips"]): row for row in modes["data_sizes"]}
    assert set(sizes) == {(name, count) for name in ("lbs", "pose_regression") for count in (1, 2, 4)}
    used = [Path(f"out/tube/lbs/sizes/{count}/run/config.yaml").read_text().count("- ") for count in (1, 2)]
    assert used == [1, 2]
    assert [row["value"] for row in modes["variants"]] == [1, 8]
    assert modes["variants"][1]["overall"] == sizes["lbs", 4]["overall"]  # 8 neighbours is how it was fitted
    assert not Path("out/tube/lbs/variants/neighbours=8").exists()
    assert [row["method"] for row in modes["robustness"]] == ["lbs", "pose_regression"]
    assert "rollouts" not in modes  # neither method has any
    tables = Path("out/tables.md").read_text()
    for title in ("one joint turns by 10 degrees", "by the number of training clips", "lbs by neighbours"):
        assert title in shown
        assert title in tables
    before = Path("out/tube/lbs/robustness.json").stat().st_mtime_ns
    assert main(["benchmark", "bench.yaml", "--out", "out", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["modes"] == modes
    assert Path("out/tube/lbs/robustness.json").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("variants.0.method=knit", "variants: no method is called knit; there are lbs, pose_regression"),
        ("variants.0.setting=threads.many", "method.threads"),
        ("variants.0.values=[0]", "method.neighbours: a whole number from 1"),
        ("data_sizes=[0.5, 0.5]", "data_sizes: a value stands there twice"),
        ("data_sizes=[1]", "data_sizes"),
        ("rollouts=[0]", "rollouts"),
        ("robustness.joints=[0]", "robustness.joints"),
    ],
)
def test_a_section_that_nobody_means_is_refused_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str], change: str, message: str
) -> None:
    assert main(["benchmark", "bench.yaml", "--out", "out", "--set", change]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not Path("out").exists()
