"""What a run keeps beside its last state, and that it goes on with nothing but what it began with."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file

from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.training.checkpoint import STATE_FORMAT, load_model, read_tensors, write_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.kept import Best, keep_checkpoint
from imgtransfer.training.loop import train
from imgtransfer.training.trainer import Trainer
from render import InputError
from render.files.atomic import written_whole
from tests.helpers.training import small_config


def same_tensors(first: Path, second: Path) -> bool:
    a, b = load_file(first), load_file(second)
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_last_checkpoints_and_the_best_model_are_kept(source: Path, tmp_path: Path) -> None:
    config = small_config(
        source, keep_checkpoints=2, checkpoint_every_steps=2, validate_every_steps=1, learning_rate=1e-3
    )
    run = tmp_path / "run"
    train(config, run)
    assert names(run / "checkpoints") == ["000000004", "000000006"]
    for name in ("state.safetensors", "model.safetensors"):
        assert same_tensors(run / "checkpoints" / "000000006" / name, run / name)
    entries = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    best = min(entries[1:], key=lambda entry: entry["position_mm"])
    assert best["position_mm"] < entries[0]["position_mm"]
    with safe_open(run / "best.safetensors", "pt") as file:
        assert json.loads(file.metadata()["imgtransfer"])["steps"] == best["step"]
    assert load_model(run / "checkpoints" / "000000004").source.endswith("model.safetensors")
    # from an earlier one, as the page says
    again = tmp_path / "again"
    shutil.copytree(run / "checkpoints" / "000000004", again)
    shutil.copy(run / "config.yaml", again)
    train(config, again, resume=True)
    assert same_tensors(again / "state.safetensors", run / "state.safetensors")


def test_fewer_checkpoints_are_kept_where_fewer_are_asked_for(tmp_path: Path) -> None:
    for step in range(4):
        for name in ("state.safetensors", "model.safetensors"):
            with written_whole(tmp_path / name) as temporary:
                temporary.write_text(str(step))
        keep_checkpoint(tmp_path, step, 3)
    assert names(tmp_path / "checkpoints") == ["000000001", "000000002", "000000003"]
    assert (tmp_path / "checkpoints" / "000000001" / "state.safetensors").read_text() == "1"
    keep_checkpoint(tmp_path, 3, 2)
    assert names(tmp_path / "checkpoints") == ["000000002", "000000003"]
    keep_checkpoint(tmp_path, 3, 1)
    assert names(tmp_path / "checkpoints") == []


def test_the_best_is_the_least_error_and_no_number_is_none() -> None:
    best = Best()
    for step, error in enumerate((5.0, 3.0, math.nan, 4.0, 3.0)):
        best.take({"position_mm": error}, step)
    assert (best.error, best.step) == (3.0, 1)
    assert Best.of_header(best.header()) == best
    assert Best.of_header(Best().header()) == Best.of_header(None) == Best()


def test_a_kill_between_state_and_best_model_costs_neither(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = small_config(source, steps=2, validate_every_steps=1, learning_rate=1e-3)
    train(config, tmp_path / "whole")
    assert (tmp_path / "whole" / "best.safetensors").exists()

    def killed(trainer: Trainer, folder: Path) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Trainer, "save_best", killed)
    saving = config.training.model_copy(update={"checkpoint_every_steps": 1})
    with pytest.raises(ZeroDivisionError):
        train(config.model_copy(update={"training": saving}), tmp_path / "run")
    monkeypatch.undo()
    train(config, tmp_path / "run", resume=True)
    assert same_tensors(tmp_path / "run" / "best.safetensors", tmp_path / "whole" / "best.safetensors")


# the data that a run began with


@pytest.fixture
def begun(tube_clip: Clip, tmp_path: Path) -> tuple[RunConfig, Path, Path]:
    """A run of one step: its configuration, its folder, and that of its clips."""
    clips = tmp_path / "clips"
    clips.mkdir()
    save_clip(clips / "first.npz", tube_clip)
    save_clip(clips / "second_test.npz", tube_clip.slice(slice(2, 5)))
    train(small_config(clips, steps=1), tmp_path / "run")
    return small_config(clips), tmp_path / "run", clips


@pytest.mark.parametrize("change", ["name", "length", "first frame", "validation"])
def test_other_data_than_a_run_began_with_are_refused(
    begun: tuple[RunConfig, Path, Path], tube_clip: Clip, change: str
) -> None:
    config, run, clips = begun
    garment = tube_clip.garment
    assert garment is not None
    if change == "name":
        (clips / "first.npz").rename(clips / "another.npz")
    elif change == "length":  # the box stays: the frames come twice
        twice = tube_clip.slice([*range(6), 0])  # type: ignore[arg-type]
        save_clip(clips / "first.npz", twice)
    elif change == "first frame":
        vertices = garment.vertices.copy()
        vertices[0] = vertices[0].mean(axis=0, keepdims=True) + 0.9 * (vertices[0] - vertices[0].mean(axis=0))
        save_clip(clips / "first.npz", replace(tube_clip, garment=Garment(vertices)))
    else:
        save_clip(clips / "second_test.npz", tube_clip.slice(slice(3, 5)))
    part = "validation" if change == "validation" else "training"
    with pytest.raises(
        InputError, match=rf"other {part} clips .* differ\); put those back|training data have changed"
    ):
        train(config, run, resume=True)


def test_a_state_that_does_not_say_what_data_it_began_with_goes_on(
    begun: tuple[RunConfig, Path, Path],
) -> None:
    config, run, _ = begun
    path = run / "state.safetensors"
    tensors, header = read_tensors(path, STATE_FORMAT)
    for key in ("data", "frames_a_step", "best"):  # as before they were written
        del header[key]
    write_tensors(path, tensors, header)
    train(config, run, resume=True)


def test_another_number_of_frames_a_step_is_refused(begun: tuple[RunConfig, Path, Path]) -> None:
    config, run, _ = begun
    changed = config.model_copy(update={"training": config.training.model_copy(update={"accumulate": 3})})
    with pytest.raises(InputError, match="a step of this run takes 2 frames, and would now take 6"):
        train(changed, run, resume=True)
