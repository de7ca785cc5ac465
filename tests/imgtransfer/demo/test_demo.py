"""The demo on a tiny data set: everything it promises is there, and a second run uses what stands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imgtransfer.config.loader import load_config, parse_config
from imgtransfer.data.clip import Clip
from imgtransfer.data.store import DataSet
from imgtransfer.demo.__main__ import main
from imgtransfer.demo.case import METHODS
from imgtransfer.demo.run import CHECKPOINT, DEMO_CONFIG, GENERAL, SAMPLE_DATA, run_demo
from imgtransfer.demo.training import Length, trained
from imgtransfer.evaluation.metrics import METRICS, evaluate_clip
from imgtransfer.pipeline.deform import deform
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from render import InputError
from tests.helpers.pages import check_page


@pytest.fixture(scope="module")
def config(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> RunConfig:
    path = tmp_path_factory.mktemp("demo") / "tubes.zarr"
    data = DataSet.create(path)
    for split in ("train", "validation", "test"):
        data.write(f"tube/{split}", tube_clip, split=split)
    return parse_config(
        RunConfig,
        {
            "data": {"source": str(path)},
            "maps": {"size": [32, 32]},
            "network": {
                "encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2},
                "blocks": 1,
                "target": "residual",
            },
            "training": {
                "steps": 4,
                "batch_frames": 2,
                "validate_every_steps": 2,
                "checkpoint_every_steps": 2,
                "threads": 1,
            },
        },
        "tiny",
    )


@pytest.fixture(scope="module")
def finished(
    config: RunConfig, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, dict[str, float]]]:
    out = tmp_path_factory.mktemp("demo-output")
    pretrained = train(config, tmp_path_factory.mktemp("pretrained") / "run")

    def after_the_first_page(*args: Any) -> Path:
        assert set(json.loads((out / "metrics.json").read_text())) == {"lbs", "fused_pretrained"}
        page = (out / "report.html").read_text()
        assert "is being trained" in page
        assert page.count("data:image/png;base64,") == 1 + 1 + 1  # overview, meshes, maps of one model
        return trained(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("imgtransfer.demo.run.trained", after_the_first_page)
        return out, run_demo(out, config, pretrained)


def test_metrics_have_one_entry_a_method_with_exactly_the_metrics(
    finished: tuple[Path, dict[str, dict[str, float]]],
) -> None:
    out, metrics = finished
    stored = json.loads((out / "metrics.json").read_text())
    assert stored == metrics
    assert set(stored) == {"lbs", "position_only", "fused", "fused_pretrained"} == set(METHODS)
    assert all(set(values) == set(METRICS) for values in stored.values())
    assert all(np.isfinite(list(values.values())).all() for values in stored.values())


def test_the_same_training_fused_twice_measures_the_same(
    finished: tuple[Path, dict[str, dict[str, float]]],
) -> None:
    # Both models of this test were trained by the same configuration and seed.
    _, metrics = finished
    assert metrics["fused"] == metrics["fused_pretrained"]


def test_everything_the_demo_promises_is_there(finished: tuple[Path, dict[str, dict[str, float]]]) -> None:
    out, _ = finished
    page = (out / "report.html").read_text()
    assert (
        page.count("data:image/png;base64,") == 1 + 1 + 2 + 3
    )  # overview, meshes, maps of two models, curves
    assert "http://" not in page
    assert "https://" not in page
    assert (out / "tube__test.glb").read_bytes()[:4] == b"glTF"
    for name in ("overview", "maps_1", "maps_2", "meshes", "training_1"):
        assert (out / f"{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    check_page(out / "report.html")


def test_a_second_run_trains_nothing_again(
    finished: tuple[Path, dict[str, dict[str, float]]], config: RunConfig
) -> None:
    out, _ = finished
    log, model = (out / "run" / "log.jsonl").read_text(), (out / "run" / "model.safetensors").read_bytes()
    assert trained(out, config, Length()).read_bytes() == model
    assert (out / "run" / "log.jsonl").read_text() == log


def test_a_longer_training_goes_on_and_a_shorter_one_begins_anew(config: RunConfig, tmp_path: Path) -> None:
    def steps() -> list[int]:
        return [json.loads(line)["step"] for line in (tmp_path / "run/log.jsonl").read_text().splitlines()]

    trained(tmp_path, config, Length(steps=2))
    first = (tmp_path / "run/log.jsonl").read_text()
    trained(tmp_path, config, Length(steps=3))
    assert steps() == [0, 1, 2, 3]
    assert (tmp_path / "run/log.jsonl").read_text().startswith(first)
    trained(tmp_path, config, Length(steps=1))
    assert steps() == [0, 1]


def test_minutes_are_turned_into_steps_once(config: RunConfig, tmp_path: Path) -> None:
    trained(tmp_path, config, Length(minutes=1e-4))
    known = json.loads((tmp_path / "length.json").read_text())
    assert known["minutes"] == 1e-4
    (tmp_path / "length.json").write_text(json.dumps(known | {"steps": 5}))
    trained(tmp_path, config, Length(minutes=1e-4))
    assert load_config(RunConfig, tmp_path / "run/config.yaml").training.steps == 5


@pytest.mark.parametrize(
    ("length", "message"),
    [
        ({"steps": 0}, "steps 0: a whole number from 1"),
        ({"minutes": float("nan")}, "minutes nan: a number of minutes above 0"),
        ({"minutes": 1.0, "steps": 2}, "give one of them"),
    ],
)
def test_lengths_without_sense_are_refused(length: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Length(**length)


def test_deform_keeps_the_garment_out_of_the_body_and_ignores_the_truth(
    finished: tuple[Path, dict[str, dict[str, float]]], tube_clip: Clip
) -> None:
    model = load_model(finished[0] / "run")
    result = deform(model, tube_clip)
    bare = replace(tube_clip, garment=None)
    np.testing.assert_array_equal(deform(model, bare).fused, result.fused)
    assert tube_clip.garment is not None
    measured = evaluate_clip(
        result.fused,
        tube_clip.garment.vertices,
        tube_clip.template.faces,
        tube_clip.body.vertices,
        tube_clip.body.faces,
    )
    assert measured["penetration_percent"] == 0


def test_a_missing_checkpoint_is_said_before_any_training(config: RunConfig, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.safetensors"):
        run_demo(tmp_path / "out", config, tmp_path / "none.safetensors")
    assert not (tmp_path / "out").exists()


def test_the_checkpoint_that_comes_with_the_project_is_that_of_its_recipe_for_the_sample_shirt() -> None:
    config, model = load_config(RunConfig, DEMO_CONFIG.with_name("pretrain.yaml")), load_model(CHECKPOINT)
    assert (model.network, model.maps) == (config.network, config.maps)
    data = DataSet.open(SAMPLE_DATA["tshirt"])
    for name in data.names():
        model.check_garment(data.read(name))
    assert CHECKPOINT.stat().st_size < 15e6


def test_the_general_checkpoint_is_that_of_its_recipe() -> None:
    config, model = load_config(RunConfig, DEMO_CONFIG.with_name("general.yaml")), load_model(GENERAL)
    assert model.general
    assert (model.network, model.asked) == (config.network, config.maps)
    assert model.mirrored_average == config.training.mirror
    assert GENERAL.stat().st_size < 15e6


@pytest.mark.parametrize("garment", sorted(SAMPLE_DATA))
def test_the_general_checkpoint_dresses_every_garment_of_the_sample_data(garment: str) -> None:
    data = DataSet.open(SAMPLE_DATA[garment])
    clip = data.read(data.names("test")[0]).slice(slice(20, 22))
    prediction = load_model(GENERAL).predict(clip)
    covered = prediction.imager.mask
    true = prediction.imager.operator(torch.from_numpy(prediction.frames.to_canonical(clip.garment.vertices)))
    assert (prediction.metres() - true)[:, covered].norm(dim=-1).mean() < 0.06


def test_an_output_folder_that_is_a_file_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr("sys.argv", ["demo", "--out", str(tmp_path / "file")])
    assert main() == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"demo: error: {tmp_path / 'file'}")
    assert (tmp_path / "file").read_text() == "mine"
