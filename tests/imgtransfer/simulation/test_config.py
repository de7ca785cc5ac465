import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.plan import plan
from render import InputError
from tests.helpers.paths import ROOT

CONFIGS = ROOT / "configs" / "data"


def written(tmp_path, text):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return path


def motion_file(path):
    np.savez(path, poses=np.zeros((20, 66)), trans=np.zeros((20, 3)), mocap_framerate=30.0)
    return path


@pytest.mark.parametrize("name", ["sample", "small", "full", "pretrain", "cmu", "general"])
def test_the_committed_configurations_are_read(name):
    assert load_config(SimulateConfig, CONFIGS / f"{name}.yaml").fps == 30


def test_the_sample_tests_on_motions_that_no_training_data_has():
    sample, pretrain = (
        plan(load_config(SimulateConfig, CONFIGS / f"{name}.yaml")) for name in ("sample", "pretrain")
    )
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
    config = load_config(SimulateConfig, written(
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
    tasks = plan(load_config(SimulateConfig, written(tmp_path, text % "false")))
    assert [task.name for task in tasks] == [
        "dress/walk_s0_anny1",
        "dress/walk_s1_anny2",
        "skirt/walk_s0",
        "skirt/walk_s1_anny1",
    ]
    assert tasks[0].config.garment.kind == "dress"
    assert tasks[0].config.bodies == ()
    every = plan(load_config(SimulateConfig, written(tmp_path, text % "true")))
    assert len({task.name for task in every}) == 12


def test_motions_take_garments_in_turn_and_other_bodies_in_the_next_round(tmp_path):
    text = """
garments: [{kind: drawn, of: skirt, draws: 2, length: [0.3, 0.6]}, {kind: dress}]
every_garment: false
bodies: [{}, {kind: drawn, seed: 1, last_seed: 2}]
clips: [{motion: walk, last_seed: 3, seconds: 1}, {motion: kick, last_seed: 1, seconds: 1, garments: [skirt-02]}]
"""
    tasks = plan(load_config(SimulateConfig, written(tmp_path, text)))
    # Turns: skirt-01, dress, skirt-02, and again with the body after the one of the first round.
    assert {task.name for task in tasks} == {
        *("skirt-01/walk_s0", "dress/walk_s1_anny1", "skirt-02/walk_s2_anny2", "skirt-01/walk_s3_anny1"),
        *("skirt-02/kick_s0_anny2", "skirt-02/kick_s1_anny1"),
    }
    assert {task.name.split("/")[0]: task.drawn for task in tasks} == {
        **{"skirt-01": True, "skirt-02": True, "dress": False}
    }


def test_a_dry_run_says_the_sizes_of_drawn_garments(tmp_path, capsys):
    path = written(tmp_path, """
garments: [{kind: drawn, draws: 2, seed: 5, length: [0, 0.2], sleeve: [0.2, 0.6], ease: 0.03}]
clips: [{motion: walk, seconds: 1}]
""")  # fmt: skip
    assert main(["simulate", str(path), "--out", str(tmp_path / "out.zarr"), "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "garment tshirt-01: ease 0.03, length 0.0782, sleeve 0.3643",
        "garment tshirt-02: ease 0.03, length 0.0705, sleeve 0.2056",
    ]
    assert lines[2].startswith("tshirt-01/walk_s0 (train): 30 frames")


@pytest.mark.parametrize(("text", "wanted"), [
    ("garment: {sleve: 1}", "garment.sleve: no such setting of tshirt, did you mean sleeve? There are detail, ease, "),
    ("garment: {kind: dress, hem: 1}", "garment.hem: no such setting of dress; there are detail, "),
    ("garment: {kind: cape}", "garment: no kind 'cape'; there are tshirt, dress, trousers, skirt, template"),
    ("garment: 5", "garment: a mapping of settings, such as {kind: ...}, is wanted, found 5"),
    ("garment: skirt", "garment: a mapping of settings is wanted, found 'skirt'"),
    ("garment: {ease: -1}", "garment.ease: a number above 0.005 and below 0.1 is wanted, found -1"),
    ("garments: [{kind: skirt}, {kind: dress, neck: 3}]", "garments.1.neck: a number from 0 to 0.15 is wanted"),
    ("garments: {kind: skirt}", "garments: a list is wanted"),
    ("garment: {detail: tiny}", "garment.detail: one of full, small is wanted, found 'tiny'"),
    ("garment: {kind: template}", "garment.path: missing; template needs it"),
    ("garment: {kind: template, path: a.obj, up: z, facing: -z}", "garment: up is z and facing -z; they must be"),
    ("garment: {kind: template, path: a.obj, unit: m, scale: 2}", "garment: unit and scale say the same"),
    ("garment: {kind: template, path: a.obj, name: a b}", "garment.name: a name of letters, digits, "),
    ("body: {seed: -3}", "body.seed: a whole number from 0 and below 9.22337e+18 is wanted, found -3"),
    ("body: {kind: smpl}", "body.path: missing; smpl needs it"),
    ("body: {shape: {heigth: 3}}", "body.shape.heigth: no such setting of shape, did you mean height? There are age"),
    ("body: {seed: 1, shape: {}}", "body: either a shape or a seed is wanted"),
    ("cloth: {stiffness: 3}", "cloth.stiffness: no such setting of cloth, did you mean contact_stiffness? "),
    ("cloth: {fabric: wool}", "cloth.fabric: one of cotton, silk, denim is wanted, found 'wool'"),
    ("solver: {min_substeps: 2.5}", "solver.min_substeps: a whole number from 1 to 10000 is wanted, found 2.5"),
    ("solver: {min_substeps: 100}", "solver: min_substeps 100 is more than max_substeps 24"),
    ("solver: 3", "solver: a mapping of settings is wanted, found 3"),
    ("gates: {speed: -1}", "gates.speed: a number from 0 on is wanted, found -1"),
    ("sequences: {speed: 0}", "sequences.speed: a number above 0 and up to 1e+09 is wanted, found 0"),
    ("clips: [{motion: fly}]", "clips.0.motion: not in the library; there are walk, "),
    ("clips: [{motoin: walk}]", "clips.0.motoin: no such setting of clips, did you mean motion? "),
    ("clips: [{motion: walk, seconds: 0}]", "clips.0.seconds: a number above 0 and up to 3600 is wanted, found 0"),
    ("clips: [{motion: walk, tempo: -1}]", "clips.0.tempo: a number from 0.01 to 100 is wanted, or a list of two "),
    ("clips: [{motion: walk, seed: 5, last_seed: 1}]", "clips.0: last_seed 1 is less than seed 5"),
    ("fps: -1", "fps: a number from 0.01 to 10000 is wanted, found -1"),
    ("fps: .inf", "fps: a number from 0.01 to 10000 is wanted, found inf"),
    ("fsp: 30", "fsp: no such setting, did you mean fps? There are bodies, "),
    ("every_body: maybe", "every_body: true or false is wanted, found 'maybe'"),
    ("{fps: -1, title: 5, cloth: 3}", "title: a text is wanted, found 5 (and 2 more)"),
    ("[1, 2]", "a mapping of settings is wanted"),
    ("a: [", "not YAML"),
])  # fmt: skip
def test_mistakes_in_a_configuration_are_named_by_its_own_keys(tmp_path, text, wanted):
    with pytest.raises(InputError) as caught:
        load_config(SimulateConfig, written(tmp_path, text))
    assert str(caught.value).startswith(f"{tmp_path}/c.yaml: {wanted}")
    assert "\n" not in str(caught.value)


def test_what_cannot_be_planned_is_refused(tmp_path):
    with pytest.raises(InputError, match="nothing to simulate"):
        plan(SimulateConfig())
    with pytest.raises(InputError, match="more than once"):
        plan(
            load_config(
                SimulateConfig, written(tmp_path, "clips: [{motion: walk, seed: 1}, {motion: walk, seed: 1}]")
            )
        )
    with pytest.raises(InputError, match="no motion file in this folder"):
        plan(SimulateConfig(), [tmp_path])
    with pytest.raises(InputError, match="frames 1: at least 2"):
        plan(load_config(SimulateConfig, CONFIGS / "sample.yaml"), frames=1)


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
    with pytest.raises(
        InputError, match=r"clips: no clip matches \(names dress/\*\); there are skirt/kick_s3_anny1"
    ):
        plan(config, clips=["dress/*"])


def test_clips_for_a_garment_that_is_none_of_those():
    given = {"garments": [{"kind": "skirt"}], "clips": [{"motion": "walk", "garments": ["dress"]}]}
    with pytest.raises(ValueError, match="dress is none of the garments skirt"):
        SimulateConfig.model_validate(given)
