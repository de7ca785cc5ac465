"""Trainings that go wrong: noticed, said in one line, and nothing bad saved over what was good."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.training.config import RunConfig, TrainingConfig
from imgtransfer.training.divergence import FACTOR, WINDOW, Diverged, LossWatch, check_finite_weights
from imgtransfer.training.loop import train
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from tests.helpers.training import small_config

STEPS = WINDOW // 2  # a window and a half, in three parts


def losses(position: float, normal: float = 0.1) -> dict[str, float]:
    return {"position_loss": position, "normal_loss": normal}


def watched(watch: LossWatch, first: int, value: float, count: int) -> None:
    for step in range(first, first + count):
        watch.check(step, losses(value))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_loss_that_is_no_number_stops_at_once(value: float) -> None:
    watch = LossWatch(TrainingConfig(learning_rate=3.0, precision="bfloat16"))
    with pytest.raises(
        Diverged, match=rf"at step 7: normal_loss is {value}; try a lower .* \(3 now\)"
    ) as caught:
        watch.check(7, losses(0.1, value))
    for advice in ("gradient_clip=1", "warmup_steps (0 now)", "precision=float32", "`imgtransfer inspect`"):
        assert advice in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mean_far_above_an_earlier_one_stops_and_less_does_not() -> None:
    watch = LossWatch(TrainingConfig())
    watched(watch, 1, 0.1, WINDOW)
    watched(watch, WINDOW + 1, 0.99 * FACTOR * 0.1, WINDOW)
    with pytest.raises(
        Diverged, match=rf"before step {3 * WINDOW}: the mean position_loss .* is 0.808, and it was 0.1;"
    ):
        watched(watch, 2 * WINDOW + 1, 1.01 * FACTOR * 0.1, WINDOW)


def test_losses_near_0_may_differ_by_any_factor() -> None:
    watch = LossWatch(TrainingConfig())
    watched(watch, 1, 1e-9, WINDOW)
    watched(watch, WINDOW + 1, 1e-5, WINDOW)


def test_a_resumed_watch_notices_what_a_whole_one_does() -> None:
    values = [0.1] * (WINDOW + STEPS) + [2.0] * STEPS
    entries = [{"step": step, **losses(value)} for step, value in enumerate(values, 1)]
    with_validation = [{"step": 0, "position_mm": 3.0}, *entries[: WINDOW + STEPS]]
    watch = LossWatch(TrainingConfig())
    watch.resumed(with_validation)
    with pytest.raises(Diverged, match=f"before step {2 * WINDOW}"):
        watched(watch, WINDOW + STEPS + 1, 2.0, STEPS)


def test_weights_that_are_not_finite_are_named() -> None:
    check_finite_weights({"a": torch.ones(2), "n": torch.tensor(3)}, 4, "try")
    with pytest.raises(Diverged, match="at step 4: b is not finite; try"):
        check_finite_weights({"a": torch.ones(2), "b": torch.tensor([1.0, math.nan])}, 4, "try")


def spoil_truth(monkeypatch: pytest.MonkeyPatch, *, from_step: int) -> None:
    """Let the true positions of training frames be no numbers from a step on."""
    real = Trainer.batch

    def batch(trainer: Trainer, frames: Frames, index: Tensor) -> tuple[BodyMaps, ImagePair]:
        body, truth = real(trainer, frames, index)
        if getattr(trainer, "step", 0) >= from_step and frames is trainer.train_frames:
            truth = ImagePair(truth.positions * math.nan, truth.normals)
        return body, truth

    monkeypatch.setattr(Trainer, "batch", batch)


def test_a_diverged_run_keeps_its_last_good_state(
    config: RunConfig, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil_truth(monkeypatch, from_step=3)
    with pytest.raises(
        Diverged, match=r"run: training diverged at step 4: .* \(what was saved at step 3 is kept\)"
    ):
        train(config, tmp_path / "run")
    monkeypatch.undo()
    train(small_config(source, steps=3), tmp_path / "good")
    kept, good = ((tmp_path / run / "state.safetensors").read_bytes() for run in ("run", "good"))
    assert len(kept) == len(good)
    lines = [json.loads(line)["step"] for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert lines == [0, 1, 2, 3]
    train(config, tmp_path / "run", resume=True)


def test_weights_that_are_not_finite_are_never_saved(config: RunConfig, tmp_path: Path) -> None:
    trainer = Trainer(config)
    trainer.save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    next(trainer.model.parameters()).data[0] = math.inf
    with pytest.raises(Diverged, match=r"diverged at step 0: model.position_net.* is not finite"):
        trainer.save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
