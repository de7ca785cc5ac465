"""What is said of a training's memory and time before its first step."""

from __future__ import annotations

import logging

import pytest
import torch

from imgtransfer.config.loader import load_config
from imgtransfer.network import MapsConfig, NetworkConfig
from imgtransfer.network.memory import training_bytes
from imgtransfer.training.config import RunConfig
from imgtransfer.training.needs import say_needs
from imgtransfer.training.trainer import Trainer
from tests.helpers.paths import ROOT


def said(config: RunConfig, seconds: list[float], caplog: pytest.LogCaptureFixture) -> str:
    """What is said of 1,000 steps of which those tried take these seconds."""
    now, left = 0.0, list(seconds)

    def step(ahead: int) -> None:
        nonlocal now
        assert ahead == len(seconds) - len(left)  # other frames each time
        now += left.pop(0)

    caplog.clear()
    caplog.set_level(logging.INFO)
    say_needs(config, 1000, step, clock=lambda: now)
    assert not left
    return caplog.messages[0]


def test_the_mean_of_all_but_the_first_counts_and_a_long_one_is_not_repeated(
    caplog: pytest.LogCaptureFixture,
) -> None:
    config = load_config(RunConfig, ROOT / "configs" / "demo.yaml")
    assert said(config, [2.0, 1.2, 3.6, 2.4], caplog).endswith(
        "and 1000 steps about 40 minutes on this machine"
    )
    assert said(config, [9.0, 3.6], caplog).endswith("and 1000 steps about 60 minutes on this machine")
    assert said(config, [36.0], caplog).endswith("and 1000 steps about 10 hours on this machine")


def test_memory_by_hand() -> None:
    """One token of 8 features an image, one block everywhere, two views, two networks, four bytes."""
    encoder = {"patch": 8, "dim": 8, "depth": 1, "heads": 1}
    network = NetworkConfig.model_validate({"encoder": encoder, "blocks": 1, "heads": 1})
    maps = MapsConfig(size=(8, 8))
    weights = 12 * 64 + 16 * 64 + 8
    kept = 2 * 8 * 12 + (20 * 8 + 4) + 5 * 8 * 7
    assert training_bytes(network, maps, batch_frames=3) == 2 * 4 * (4 * weights + 6 * kept)
    averaged = training_bytes(network, maps, batch_frames=3, averaged=True)
    assert averaged == 2 * 4 * (5 * weights + 6 * kept)


def test_a_rehearsal_changes_nothing(config: RunConfig) -> None:
    trainers = [Trainer(config) for _ in range(2)]
    trainers[0].rehearse()
    trainers[0].rehearse(3)
    losses = [trainer.train_step() for trainer in trainers]
    assert losses[0] == losses[1]
    states = [trainer.model.state_dict() for trainer in trainers]
    assert all(torch.equal(states[0][name], value) for name, value in states[1].items())


def test_a_run_that_is_over_says_nothing(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    config = load_config(RunConfig, ROOT / "configs" / "demo.yaml")
    say_needs(config, 0, lambda ahead: None)
    assert not caplog.messages
