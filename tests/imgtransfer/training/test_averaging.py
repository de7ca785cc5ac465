"""The moving average of weights, and what a run does with it."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from imgtransfer.network import NetworkConfig
from imgtransfer.training.averaging import WeightAverage
from imgtransfer.training.checkpoint import averaged_weights
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.models import LOCAL
from tests.helpers.training import SMALL, small_config


def test_the_mean_by_hand() -> None:
    layer = nn.Linear(1, 1, bias=False)
    layer.weight.data.fill_(1.0)
    average = WeightAverage(layer, 0.5)
    layer.weight.data.fill_(3.0)
    average.update(1)  # warm-up: 2 / 11 remains
    layer.weight.data.fill_(5.0)
    average.update(100)  # 101 / 110 would remain, 0.5 does
    want = 0.5 * (2 / 11 * 1 + 9 / 11 * 3) + 0.5 * 5
    assert average.tensors()["weight"].item() == pytest.approx(want)
    assert layer.weight.item() == 5.0
    with average.in_place():
        assert layer.weight.item() == pytest.approx(want)
    assert layer.weight.item() == 5.0


def test_a_run_validates_and_writes_the_averaged_weights(source: Path, tmp_path: Path) -> None:
    trainer = Trainer(small_config(source, ema=0.8))
    for _ in range(3):
        trainer.train_step()
    last = trainer.validate()
    trainer.save(tmp_path)
    model, state = (load_file(tmp_path / f"{name}.safetensors") for name in ("model", "state"))
    names = [name for name, _ in trainer.model.named_parameters()]
    assert all(torch.equal(model[f"model.{name}"], state[f"average.{name}"]) for name in names)
    assert any(not torch.equal(model[f"model.{name}"], state[f"model.{name}"]) for name in names)
    trainer.model.load_state_dict(
        {key.removeprefix("model."): v for key, v in model.items() if "model." in key}
    )
    trainer._average = None
    assert trainer.validate() == pytest.approx(last, rel=1e-6)


def stop_at(monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    """Ctrl-C in the middle of a step."""
    original = Trainer.train_step

    def interrupted(trainer: Trainer) -> dict[str, float]:
        if trainer.step == step:
            os.kill(os.getpid(), signal.SIGINT)
        return original(trainer)

    monkeypatch.setattr(Trainer, "train_step", interrupted)


@pytest.mark.parametrize("network", [SMALL["network"], LOCAL], ids=["images", "local"])
def test_a_run_with_averaged_weights_and_dropout_resumes_bit_for_bit(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, network: dict[str, Any]
) -> None:
    config = small_config(source, ema=0.9, weight_decay=0.5, steps=4)
    network = network | {"dropout": 0.3}
    config = config.model_copy(update={"network": NetworkConfig.model_validate(network)})
    train(config, tmp_path / "whole")
    stop_at(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "parts")
    monkeypatch.undo()
    torch.rand(7)  # whatever else draws numbers
    train(config, tmp_path / "parts", resume=True)
    for file in ("state.safetensors", "model.safetensors"):
        wanted, found = (load_file(tmp_path / run / file) for run in ("whole", "parts"))
        assert wanted.keys() == found.keys()
        assert all(torch.equal(wanted[key], found[key]) for key in wanted)


def test_a_damaged_average_is_refused(config: RunConfig) -> None:
    model = Trainer(config).model
    mean = {f"average.{name}": weight for name, weight in model.named_parameters()}
    assert averaged_weights(mean, model, Path("state")).keys() == dict(model.named_parameters()).keys()
    first = "average.position_net.encoder.norm.weight"
    for changed in ({}, mean | {first: mean[first][:1]}, mean | {"average.wings": mean[first]}):
        with pytest.raises(InputError, match="state: damaged, its averaged weights do not fit the model"):
            averaged_weights(changed, model, Path("state"))
    with pytest.raises(InputError, match="not finite"):
        averaged_weights({**mean, first: mean[first] * torch.nan}, model, Path("state"))
