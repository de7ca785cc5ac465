"""Runs and model files with a pretrained encoder."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from imgtransfer.config.loader import parse_config
from imgtransfer.data.clip import Clip
from imgtransfer.network.memory import least_weights
from imgtransfer.training.checkpoint import MODEL_FILE, load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.hub import checkpoint
from tests.helpers.training import hub_config


@pytest.fixture(scope="module")
def run(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose checkpoint is gone by now."""
    folder, out = checkpoint(tmp_path_factory.mktemp("encoder")), tmp_path_factory.mktemp("runs") / "run"
    train(hub_config(source, folder), out)
    shutil.rmtree(folder)
    return out


def test_a_model_file_predicts_without_the_checkpoint(run: Path, tube_clip: Clip) -> None:
    model = load_model(run)
    prediction = model.predict(tube_clip)
    assert prediction.positions.isfinite().all()
    assert model.architecture is not None
    assert model.architecture["image_size"] == [32, 32]
    with safe_open(run / MODEL_FILE, "pt") as file:
        names = set(file.keys())
    assert "model.position_net.encoder.hub.layers.0.attention.q_proj.weight" in names


def test_frozen_weights_stay_and_others_change(source: Path, tmp_path: Path) -> None:
    trainer = Trainer(hub_config(source, checkpoint(tmp_path), ema=0.9, weight_decay=0.5))
    before = {name: weight.detach().clone() for name, weight in trainer.model.named_parameters()}
    trainer.train_step()
    trainer.train_step()
    changed = {
        name for name, weight in trainer.model.named_parameters() if not torch.equal(weight, before[name])
    }
    frozen = {name for name, weight in trainer.model.named_parameters() if not weight.requires_grad}
    assert frozen
    assert not changed & frozen
    assert {name.split(".layers.")[1][0] for name in changed if ".layers." in name} == {"1", "2"}
    tokens, _ = trainer.model.encode_garment(trainer.model.garment())
    assert tokens.requires_grad


def test_a_run_goes_on_bit_for_bit(source: Path, tmp_path: Path) -> None:
    folder = checkpoint(tmp_path / "encoder")
    whole = train(hub_config(source, folder), tmp_path / "whole")
    config = hub_config(source, folder)
    trainer = Trainer(config)
    for _ in range(3):
        trainer.train_step()
    trainer.save(tmp_path)
    again = Trainer(config)
    again.load(tmp_path)
    assert again.step == 3
    while again.step < config.training.steps:
        again.train_step()
    wanted = load_model(whole).state_dict()
    assert all(torch.equal(wanted[name], value) for name, value in again.model.state_dict().items())


def test_a_run_begins_with_a_trained_model(run: Path, source: Path) -> None:
    known = load_model(run)
    folder = Path(str(known.network.encoder.model_dump()["name"]))
    checkpoint(folder)
    trainer = Trainer(hub_config(source, folder, init=str(run)))
    shutil.rmtree(folder)
    wanted = known.state_dict()
    assert all(torch.equal(wanted[name], value) for name, value in trainer.model.state_dict().items())
    trainer.train_step()


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda header: header.pop("encoder"), "not a model that this version can read"),
        (lambda header: header.update(encoder="vit"), "an encoder with model_type"),
        (lambda header: header["encoder"].update(hidden_size=10**9), "hidden_size must be from 1 to 8192"),
        (
            lambda header: header["encoder"].update(hidden_size=8192, num_hidden_layers=40),
            "another architecture",
        ),
        (lambda header: header["encoder"].update(intermediate_size=40), "another architecture"),
        (
            lambda header: header["network"].update(encoder={"kind": "vit"}),
            "not a model that this version can read",
        ),
    ],
)
def test_a_header_that_is_not_so(
    edit: Callable[[dict[str, Any]], object], said: str, run: Path, tmp_path: Path
) -> None:
    with safe_open(run / MODEL_FILE, "pt") as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118, not a dict
        header = json.loads(file.metadata()["imgtransfer"])
    edit(header)
    save_file(tensors, tmp_path / MODEL_FILE, {"imgtransfer": json.dumps(header)})
    with pytest.raises(InputError) as refused:
        load_model(tmp_path)
    assert said in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path))


def test_a_pretrained_network_has_no_fewer_weights_than_is_told(run: Path) -> None:
    model = load_model(run)
    network = model.position_net
    count = sum(value.numel() for value in network.state_dict().values())
    least = least_weights(model.network, model.maps, model.architecture)
    assert count >= least > sum(value.numel() for value in network.encoder.state_dict().values())


def test_the_body_around_patches_has_no_pretrained_encoder(source: Path, tmp_path: Path) -> None:
    values = hub_config(source, tmp_path).model_dump(mode="json")
    values["network"] |= {"body": "local", "shortcuts": False}
    with pytest.raises(InputError, match=r"body: local needs encoder\.kind: vit, found hub"):
        parse_config(RunConfig, values, "small")
