"""Runs that begin with a trained model."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config, parse_config, to_yaml
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.training.checkpoint import fingerprint, load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.start import chosen_frames
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.training import SMALL, small_config


@pytest.fixture(scope="module")
def trained(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of two steps: read only."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    train(small_config(source, steps=2), folder)
    return folder


def config_with(source: Path, init: Path, section: str, **changes: Any) -> RunConfig:
    """`small_config` beginning with a model, with changes of a section."""
    content = small_config(source, init=str(init)).model_dump(mode="json")
    content[section] |= changes
    return parse_config(RunConfig, content, "run")


def test_a_run_begins_with_the_weights_of_a_model(source: Path, trained: Path, tube_clip: Clip) -> None:
    known = load_model(trained)
    model = Trainer(small_config(source, init=str(trained), seed=7, steps=9)).model
    for name, value in known.state_dict().items():  # the shortcuts' statistics, too
        assert torch.equal(model.state_dict()[name], value)
    assert torch.equal(model.eval().predict(tube_clip).positions, known.predict(tube_clip).positions)


def test_one_of_several_sources_may_have_no_clip_that_matches(
    source: Path, tube_clip: Clip, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    more = tmp_path / "more"
    more.mkdir()
    save_clip(more / "walk.npz", tube_clip)  # none to validate on
    content = small_config(source).model_dump(mode="json")

    def frames_of(sources: list[Path], part: str) -> int:
        content["data"]["source"] = [str(each) for each in sources]
        config = parse_config(RunConfig, content, "run")
        return len(chosen_frames(config, getattr(config.data, part)))

    assert frames_of([source, more], "validation") == frames_of([source], "validation")
    assert caplog.messages == [
        f"{more}: no clip matches (names *_test); there are walk; the clips of the other data sets are taken"
    ]
    assert frames_of([source, more], "train") == frames_of([source], "train") + tube_clip.n_frames
    with pytest.raises(InputError, match=r"more: no clip matches .*; .*more: no clip matches"):
        frames_of([more, more], "validation")


def test_more_motion_does_not_change_what_images_mean(
    source: Path, trained: Path, tube_clip: Clip, tmp_path: Path
) -> None:
    assert tube_clip.garment is not None
    wide = replace(tube_clip.garment, vertices=tube_clip.garment.vertices * np.float32(1.2))
    for name in ("wide", "wide_test"):
        save_clip(tmp_path / f"{name}.npz", replace(tube_clip, garment=wide))
    boxes = [Trainer(small_config(tmp_path, init=str(trained))).model.box, load_model(trained).box]
    assert np.array_equal(boxes[0].hi, boxes[1].hi)


def test_the_command_begins_with_a_model_and_says_so(
    source: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.yaml").write_text(to_yaml(small_config(source, steps=1)))
    out = tmp_path / "out"
    command = ["train", str(tmp_path / "run.yaml"), "--out", str(out)]
    assert main([*command, "--init", str(trained)]) == 0
    assert load_config(RunConfig, out / "config.yaml").training.init == trained
    first = json.loads((out / "log.jsonl").read_text().splitlines()[0])
    assert (first["init"], first["init_sha256"]) == (str(trained), fingerprint(trained))
    capsys.readouterr()
    assert main([*command, "--resume"]) == 2
    assert "cannot resume, training.init is None now and was" in capsys.readouterr().err
    assert main([*command, "--init", str(trained), "--resume"]) == 0
    assert main([*command, "--init", str(trained), "--set", "training.init=other"]) == 2
    assert "--init decides what --set training.init=other would change" in capsys.readouterr().err


def test_a_run_begun_otherwise_does_not_go_on_with_a_model(
    source: Path, trained: Path, tmp_path: Path
) -> None:
    train(small_config(source, steps=1), tmp_path / "run")
    with pytest.raises(InputError, match=r"cannot resume, training.init is .* now and was None; set it back"):
        train(small_config(source, steps=1, init=str(trained)), tmp_path / "run", resume=True)


def test_a_model_that_has_changed_since_is_noticed(source: Path, trained: Path, tmp_path: Path) -> None:
    model = tmp_path / "model.safetensors"
    model.write_bytes((trained / "model.safetensors").read_bytes())
    config = small_config(source, steps=1, init=str(model))
    train(config, tmp_path / "run")
    train(small_config(source, steps=1, seed=3), tmp_path / "other")
    model.write_bytes((tmp_path / "other" / "model.safetensors").read_bytes())
    with pytest.raises(InputError, match=r"the run began with another model than .* is now"):
        train(config, tmp_path / "run", resume=True)


@pytest.mark.parametrize(
    ("section", "changes", "message"),
    [
        ("maps", {"size": [64, 32]}, r"trained with maps.size \[32, 32\], and the run has \[64, 32\]"),
        (
            "maps",
            {"views": ["front"]},
            r"trained with maps.views \['front', 'back'\], and the run has \['front'\]",
        ),
        ("maps", {"root": "heading"}, "trained with maps.root root, and the run has heading"),
        ("network", {"blocks": 2}, "trained with network.blocks 1, and the run has 2"),
        (
            "network",
            {"encoder": {**SMALL["network"]["encoder"], "dim": 32}},  # type: ignore[dict-item]
            "trained with network.encoder.dim 16, and the run has 32",
        ),
    ],
)
def test_a_model_that_does_not_fit_the_run_is_one_line(
    source: Path, trained: Path, section: str, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as error:
        Trainer(config_with(source, trained, section, **changes))
    assert "\n" not in str(error.value)


def test_a_model_that_is_not_there_is_one_line(source: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gone: no such file"):
        Trainer(small_config(source, init=str(tmp_path / "gone")))


def test_dropout_may_be_another(source: Path, trained: Path) -> None:
    Trainer(config_with(source, trained, "network", dropout=0.2))


def test_a_model_of_another_garment_is_refused(trained: Path, tube_clip: Clip, tmp_path: Path) -> None:
    assert tube_clip.garment is not None
    other = replace(tube_clip, template=replace(tube_clip.template, faces=tube_clip.template.faces[:-1]))
    for name in ("cut", "cut_test"):
        save_clip(tmp_path / f"{name}.npz", other)
    with pytest.raises(
        InputError, match=r"run: this model's garment \(192 vertices, 352 faces\) is not that of cut"
    ):
        Trainer(small_config(tmp_path, init=str(trained)))
