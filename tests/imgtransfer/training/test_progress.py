"""What a long run tells of itself: its page, curves elsewhere, frames that are fused, and when nothing gets better."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.pipeline.deform import deform
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig, TrainingConfig
from imgtransfer.training.geometry import chosen_runs
from imgtransfer.training.loop import train
from imgtransfer.training.standstill import VALIDATIONS, what_to_look_at
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.pages import check_page
from tests.helpers.training import small_config


def entries(run: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


# the page, TensorBoard, and what is fused


@pytest.fixture(scope="module")
def told(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that tells all it can: read only."""
    run = tmp_path_factory.mktemp("told") / "run"
    train(small_config(source, tensorboard=True, geometry_every_steps=4, geometry_frames=2), run)
    return run


def test_the_page_has_curves_and_pictures_of_each_validation(told: Path) -> None:
    page = (told / "report.html").read_text()
    assert sorted(path.name for path in (told / "progress").iterdir()) == [
        f"{step:09d}.png" for step in (0, 3, 6)
    ]
    assert re.findall(r"<figcaption>(.*?)</figcaption>", page) == ["true", "step 0", "step 3", "step 6"]
    for text in (
        "6 of 6, of 2 frames each",
        "frames a second",
        "it has ended",
        "second_test, frame ",
        "mm in the mean",
    ):
        assert text in page
    assert page.count('class="plot"') == 5  # losses, millimetres, degrees, STED, rate
    assert 'src="http' not in page
    check_page(told / "report.html")


def test_what_is_fused_in_training_is_what_the_commands_fuse(told: Path, tube_clip: Clip) -> None:
    measured = {entry["step"]: entry for entry in entries(told) if "fused_rmse_mm" in entry}
    assert list(measured) == [4, 6]
    clip = tube_clip.slice(slice(2, 5))  # the validation clip, which has no more than one run
    fused = deform(load_model(told), clip).fused
    assert clip.garment is not None
    error = torch.from_numpy(fused - clip.garment.vertices).norm(dim=-1).mean().item() * 1000
    assert measured[6]["fused_rmse_mm"] == pytest.approx(error, rel=1e-4)
    assert 0 < measured[6]["fused_sted"] < 1


def test_tensorboard_gets_what_the_log_gets(told: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # noqa: PLC0415

    events = EventAccumulator(str(told / "tensorboard")).Reload()
    lines = [entry for entry in entries(told) if "position_loss" in entry]
    scalars = events.Scalars("position_loss")
    assert [one.step for one in scalars] == [entry["step"] for entry in lines]
    assert [one.value for one in scalars] == pytest.approx([entry["position_loss"] for entry in lines])
    assert {"position_mm", "fused_rmse_mm", "learning_rate"} <= set(events.Tags()["scalars"])


@pytest.mark.skipif(find_spec("wandb") is not None, reason="wandb is installed")
def test_a_missing_package_is_one_line_before_anything_is_computed(config: RunConfig, tmp_path: Path) -> None:
    wanted = config.model_copy(update={"training": config.training.model_copy(update={"wandb": "project"})})
    with pytest.raises(
        InputError, match=r"training.wandb needs the package wandb: pip install 'imgtransfer\[wandb\]'"
    ):
        train(wanted, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_runs_of_frames_are_spread_over_the_clips() -> None:
    assert chosen_runs([10, 1, 20, 30], 8) == [(0, 3), (3, 13)]
    assert chosen_runs([10, 20], 16) == [(0, 2), (0, 4), (1, 4), (1, 12)]
    assert chosen_runs([3], 8) == [(0, 0), (0, 0)]
    assert chosen_runs([1, 1], 8) == []
    assert chosen_runs([12], 2) == [(0, 4)]


def test_the_worst_frame_is_the_one_with_the_greatest_error(source: Path) -> None:
    trainer = Trainer(small_config(source, mirror=False))
    trainer.train_step()
    whole = trainer.validate()["position_mm"]
    assert trainer.validation.worst is not None
    errors = []
    for frame in range(3):
        trainer.validation._index = torch.tensor([frame])
        errors.append(trainer.validate()["position_mm"])
        assert trainer.validation.worst == (frame, pytest.approx(errors[-1], rel=1e-5))
    trainer.validation._index = torch.arange(3)
    trainer.validate()
    assert trainer.validation.worst == (
        max(range(3), key=errors.__getitem__),
        pytest.approx(max(errors), rel=1e-5),
    )
    assert whole == pytest.approx(sum(errors) / 3, rel=1e-5)
    assert trainer.validation_frames.label(1) == "second_test, frame 1"
    assert trainer.train_frames.label(5) == "first, frame 5"


# when the error stands still


def log(errors: list[float], losses: list[float], guess: float = 100.0) -> list[dict[str, float]]:
    """A log with a validation after every second step."""
    lines: list[dict[str, float]] = [{"step": 0, "position_mm": errors[0], "guess_position_mm": guess}]
    for step, loss in enumerate(losses, 1):
        line = {"step": step, "position_loss": loss}
        if step % 2 == 0:
            line |= {"position_mm": errors[step // 2], "guess_position_mm": guess}
        lines.append(line)
    return lines


STILL, FALLING = [20.0, 10.0, *[10.0] * VALIDATIONS], [20.0, 10.0, 9.0, 8.0, 7.0, 6.0, 5.0]


def test_nothing_is_said_while_the_error_falls_or_it_is_too_early() -> None:
    assert what_to_look_at(log(FALLING, [1.0] * 12), TrainingConfig()) == []
    assert what_to_look_at(log(STILL[:-2], [1.0] * 8), TrainingConfig()) == []


@pytest.mark.parametrize(
    ("losses", "text"),
    [
        ([1 / step for step in range(1, 13)], "learn the training clips by heart"),
        ([1.0] * 12, "the learning rate first"),
    ],
)
def test_a_standstill_is_told_from_learning_by_heart(losses: list[float], text: str) -> None:
    said = what_to_look_at(log(STILL, losses), TrainingConfig())
    assert said[0].startswith("The last 5 validations are not better than those before: 10.00 mm at best")
    assert text in said[1]
    assert not any("first guess" in line for line in said)
    assert "first guess is better" in what_to_look_at(log(STILL, losses, guess=9.0), TrainingConfig())[2]
