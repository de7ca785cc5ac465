from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.simulation.config import SimulateConfig, load_config
from imgtransfer.simulation.plan import plan
from render import InputError

CONFIGS = Path(__file__).parents[2] / "configs" / "data"


def written(tmp_path, text):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return path


def motion_file(path):
    np.savez(path, poses=np.zeros((20, 66)), trans=np.zeros((20, 3)), mocap_framerate=30.0)
    return path


@pytest.mark.parametrize("name", ["sample", "small", "full", "pretrain", "cmu"])
def test_the_committed_configurations_are_read(name):
    assert load_config(CONFIGS / f"{name}.yaml").fps == 30


def test_the_sample_tests_on_motions_that_no_training_data_has():
    sample, pretrain = (plan(load_config(CONFIGS / f"{name}.yaml")) for name in ("sample", "pretrain"))
    frames = dict.fromkeys(("tshirt", "dress", "trousers", "skirt"), 0)
    for task in sample:
        frames[task.name.partition("/")[0]] += len(task.motion.poses)
    assert frames == {"tshirt": 600, "dress": 300, "trousers": 300, "skirt": 300}
    tested = {task.motion.name.split("_")[0] for task in sample if task.split == "test"}
    trained = {task.motion.name.split("_")[0] for task in [*sample, *pretrain] if task.split == "train"}
    assert len(tested) == 2
    assert not tested & trained
    assert not {task.name for task in sample} & {task.name for task in pretrain}
    assert 5500 < sum(len(task.motion.poses) for task in pretrain) < 8500


def test_seed_ranges_and_tempo_ranges_unfold(tmp_path):
    config = load_config(written(
        tmp_path, "clips: [{motion: walk, seed: 3, last_seed: 5, tempo: [0.8, 1.2], seconds: 1, split: test}]"
    ))  # fmt: skip
    tasks = plan(config, frames=12)
    assert [task.name for task in tasks] == ["tshirt/walk_s3", "tshirt/walk_s4", "tshirt/walk_s5"]
    assert all(task.split == "test" and len(task.motion.poses) == 12 for task in tasks)


def test_motion_files_get_their_split_by_name(tmp_path):
    for name in ("run_a", "run_b", "hop"):
        motion_file(tmp_path / f"{name}.npz")
    config = SimulateConfig(files={"test": ("run_*",), "validation": ("run_a", "hop"), "arms_out": 0})
    splits = {task.motion.name: task.split for task in plan(config, [tmp_path])}
    assert splits == {"run_a": "test", "run_b": "test", "hop": "validation"}


def test_garments_are_worn_by_the_bodies_in_turn_or_by_all(tmp_path):
    text = """
garments: [{kind: skirt}, {kind: dress}]
bodies: [{}, {seed: 1}, {seed: 2}]
every_body: %s
clips: [{motion: walk, last_seed: 1, seconds: 1}]
"""
    tasks = plan(load_config(written(tmp_path, text % "false")))
    assert [task.name for task in tasks] == [
        "dress/walk_s0_anny1",
        "dress/walk_s1_anny2",
        "skirt/walk_s0",
        "skirt/walk_s1_anny1",
    ]
    assert tasks[0].config.garment.kind == "dress"
    assert tasks[0].config.bodies == ()
    every = plan(load_config(written(tmp_path, text % "true")))
    assert len({task.name for task in every}) == 12


@pytest.mark.parametrize(("text", "wanted"), [
    ("cloth: {stiffness: 3}", "cloth.stiffness"),
    ("clips: [{motion: fly}]", "not in the library"),
    ("clips: [{motion: walk, seconds: 0}]", "clips.0.seconds"),
    ("fps: -1", "fps"),
    ("[1, 2]", "a mapping of settings is wanted"),
    ("a: [", "not YAML"),
])  # fmt: skip
def test_mistakes_in_a_configuration_are_named(tmp_path, text, wanted):
    with pytest.raises(InputError, match=wanted):
        load_config(written(tmp_path, text))


def test_what_cannot_be_planned_is_refused(tmp_path):
    with pytest.raises(InputError, match="nothing to simulate"):
        plan(SimulateConfig())
    with pytest.raises(InputError, match="more than once"):
        plan(load_config(written(tmp_path, "clips: [{motion: walk, seed: 1}, {motion: walk, seed: 1}]")))
    with pytest.raises(InputError, match="no motion file in this folder"):
        plan(SimulateConfig(), [tmp_path])
    with pytest.raises(InputError, match="--frames 1"):
        plan(load_config(CONFIGS / "sample.yaml"), frames=1)


def test_the_command_says_in_one_line_what_is_wrong(tmp_path, capsys):
    out = tmp_path / "out.zarr"
    assert main(["simulate", str(tmp_path / "none.yaml"), "--out", str(out)]) == 2
    assert "no such file" in capsys.readouterr().err
    assert not out.exists()
    both = [str(CONFIGS / "sample.yaml"), str(CONFIGS / "cmu.yaml")]
    assert main(["simulate", *both, "--out", str(out)]) == 2
    assert "one configuration at a time" in capsys.readouterr().err


def test_clips_for_some_garments_only():
    config = SimulateConfig.model_validate(
        {
            "garments": [{"kind": "tshirt"}, {"kind": "skirt"}],
            "bodies": [{}, {"seed": 1}],
            "clips": [
                {"motion": "walk", "seed": 3},
                {"motion": "punch", "seed": 3, "garments": ["tshirt"]},
                {"motion": "kick", "seed": 3},
            ],
        }
    )
    names = [task.name for task in plan(config)]
    # A motion that a garment is left out of still counts in the turns that bodies take.
    assert names == [
        "skirt/walk_s3_anny1",
        "skirt/kick_s3_anny1",
        "tshirt/walk_s3",
        "tshirt/kick_s3",
        "tshirt/punch_s3_anny1",
    ]
    assert [task.name for task in plan(config, clips=["skirt/*", "*/punch*"])] == [
        *names[:2],
        "tshirt/punch_s3_anny1",
    ]
    with pytest.raises(InputError, match="--clip dress/\\*: no clip matches; there are skirt/kick_s3_anny1"):
        plan(config, clips=["dress/*"])


def test_clips_for_a_garment_that_is_none_of_those():
    given = {"garments": [{"kind": "skirt"}], "clips": [{"motion": "walk", "garments": ["dress"]}]}
    with pytest.raises(ValueError, match="dress is none of the garments skirt"):
        SimulateConfig.model_validate(given)
