"""A step in several batches, in one process or more."""

from __future__ import annotations

import signal
from pathlib import Path

import psutil
import pytest
import torch
from safetensors.torch import load_file

from imgtransfer.config.loader import to_yaml
from imgtransfer.network import NetworkConfig
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.order import Order
from imgtransfer.training.processes import Processes, is_main
from imgtransfer.training.trainer import Trainer
from tests.helpers.launching import launched, wait_for_entry
from tests.helpers.models import LOCAL
from tests.helpers.training import small_config


def weights(trainer: Trainer) -> torch.Tensor:
    return torch.cat([weight.detach().flatten() for weight in trainer.model.parameters()])


def test_batches_that_are_accumulated_give_what_one_of_all_their_frames_gives(source: Path) -> None:
    trainers = [
        Trainer(small_config(source, batch_frames=frames, accumulate=count, learning_rate=1e-3))
        for frames, count in ((4, 1), (2, 2), (1, 4))
    ]
    for trainer in trainers:
        torch.manual_seed(1)
        for weight in trainer.model.parameters():  # residual networks start with 0
            weight.data.add_(0.02 * torch.randn_like(weight))
    told = [trainer.train_step() for trainer in trainers]
    for other, losses in zip(trainers[1:], told[1:], strict=True):
        assert losses == pytest.approx(told[0], rel=1e-4)
        # Of the gradients: Adam's first steps are as long whatever the gradient, so that rounding of tiny ones shows.
        for one, its in zip(trainers[0].model.parameters(), other.model.parameters(), strict=True):
            torch.testing.assert_close(its.grad, one.grad, rtol=1e-3, atol=1e-6)


def test_each_process_has_its_own_parts_of_a_step() -> None:
    cpu = torch.device("cpu")
    parts = [list(Processes(cpu, 3, number).parts(2)) for number in range(3)]
    assert parts == [[0, 3], [1, 4], [2, 5]]
    assert list(Processes(cpu).parts(3)) == [0, 1, 2]


def test_parts_of_a_step_draw_numbers_of_their_own() -> None:
    order = Order(5, 2, seed=3)
    seeds = {order.step_seed(step, part) for step in range(4) for part in range(4)}
    assert len(seeds) == 16
    assert order.step_seed(2, 0) == order.step_seed(2)


def test_one_process_waits_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = Processes.joined("cpu")
    assert (alone.count, alone.number, alone.main, is_main()) == (1, 0, True, True)
    assert alone.total({"a": 2.0}) == alone.mean({"a": 2.0}) == {"a": 2.0}
    assert (alone.any(True), alone.any(False)) == (True, False)
    monkeypatch.setenv("WORLD_SIZE", "2")  # that other programs set, too
    assert Processes.joined("cpu").count == 1


def trained_apart(folder: Path, config: RunConfig, count: int, port: int) -> Path:
    """The folder of a run that `count` processes have trained."""
    (folder / "run.yaml").write_text(to_yaml(config))
    process = launched(count, "train", str(folder / "run.yaml"), "--out", str(folder / "run"), port=port)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err[-3000:]
    assert out.count("model   ") == 1  # one process tells of the run
    assert err.count("number type:") == 1
    return folder / "run"


@pytest.mark.long
def test_two_processes_give_what_one_gives_with_twice_the_batch(source: Path, tmp_path: Path) -> None:
    options = {"steps": 3, "ema": 0.9, "learning_rate": 1e-3}
    apart = trained_apart(tmp_path, small_config(source, batch_frames=1, **options), 2, 29641)
    train(small_config(source, batch_frames=1, accumulate=2, **options), tmp_path / "accumulated")
    train(small_config(source, batch_frames=2, **options), tmp_path / "doubled")
    states = [
        load_file(folder / "state.safetensors")
        for folder in (apart, tmp_path / "accumulated", tmp_path / "doubled")
    ]
    assert states[0].keys() == states[1].keys() == states[2].keys()
    assert all(torch.equal(states[0][key], states[1][key]) for key in states[0])
    for key in states[0]:
        torch.testing.assert_close(states[0][key], states[2][key], rtol=1e-3, atol=2e-4)


@pytest.mark.long
def test_two_processes_share_a_local_network_with_dropout_and_a_head(source: Path, tmp_path: Path) -> None:
    network = NetworkConfig.model_validate(
        LOCAL | {"dropout": 0.3, "head": {"kind": "kernel", "patches": 3, "ridge": 1e-6}}
    )

    def config(**options: object) -> RunConfig:
        small = small_config(source, batch_frames=1, steps=2, learning_rate=1e-3, **options)
        return small.model_copy(update={"network": network})

    apart = trained_apart(tmp_path, config(), 2, 29642)
    train(config(accumulate=2), tmp_path / "accumulated")
    a, b = (load_file(folder / "state.safetensors") for folder in (apart, tmp_path / "accumulated"))
    assert all(torch.equal(a[key], b[key]) for key in b)


@pytest.mark.long
def test_a_signal_to_one_process_stops_all_after_the_same_step(source: Path, tmp_path: Path) -> None:
    config = small_config(
        source, batch_frames=1, steps=5000, validate_every_steps=5000, checkpoint_every_steps=5000
    )
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    words = ["train", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "run")]
    launcher = launched(2, *words, port=29643)
    assert wait_for_entry(launcher, tmp_path / "run" / "log.jsonl")
    *_, last = psutil.Process(launcher.pid).children()
    last.send_signal(signal.SIGTERM)
    _, err = launcher.communicate(timeout=120)
    assert launcher.returncode != 0
    assert "the same command with --resume goes on" in err
    steps = load_file(tmp_path / "run" / "state.safetensors").get("optimizer.0.step", torch.tensor(0.0))
    lines = (tmp_path / "run" / "log.jsonl").read_text().splitlines()
    assert len(lines) == int(steps) + 1
