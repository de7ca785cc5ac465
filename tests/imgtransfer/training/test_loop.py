"""Training runs that are killed, stopped, out of disk, damaged, or two in one folder."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from imgtransfer.cli.main import main
from imgtransfer.config.loader import to_yaml
from imgtransfer.report.logs import read_curves
from imgtransfer.training import loop
from imgtransfer.training.checkpoint import load_model, optimizer_state
from imgtransfer.training.config import RunConfig
from imgtransfer.training.log import log_from
from imgtransfer.training.loop import train
from imgtransfer.training.run_folder import only_trainer, state_to_resume
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.full_disk import full_disk
from tests.helpers.training import small_config


def steps(out: Path) -> list[int]:
    return [json.loads(line)["step"] for line in (out / "log.jsonl").read_text().splitlines()]


def in_step(monkeypatch: pytest.MonkeyPatch, number: int, happens: Callable[[], object]) -> None:
    """Let something happen in the middle of a step."""
    real = Trainer.train_step

    def step(trainer: Trainer) -> dict[str, float]:
        if trainer.step == number - 1:
            happens()
        return real(trainer)

    monkeypatch.setattr(Trainer, "train_step", step)


# stopped, and given more steps


def test_sigterm_saves_what_is_done_and_the_run_goes_on_to_more_steps(
    config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    command = ["train", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "run")]
    in_step(monkeypatch, 2, lambda: os.kill(os.getpid(), signal.SIGTERM))
    assert main(command) == 143
    assert "stopped after step 2; the same command with --resume goes on" in capsys.readouterr().err
    monkeypatch.undo()
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    assert main([*command, "--resume", "--set", "training.steps=4", "--set", "training.stored=float16"]) == 0
    err = capsys.readouterr().err
    assert "training.steps is 4 now and was 6, training.stored is float16 now and was float32" in err
    assert "the learning rate is 0.005 where it was 0.0075" in err  # cosine, after 2 of 4 and of 6 steps
    assert steps(tmp_path / "run") == [0, 1, 2, 3, 4]
    assert main([*command, "--resume", "--set", "training.steps=3"]) == 2
    assert "the run has done 4 already; at least 4 are wanted" in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "config.yaml",
        "log.jsonl",
        "model.safetensors",
        "progress",
        "report.html",
        "state.safetensors",
    ]


def test_a_slow_run_is_saved_by_the_clock(
    config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "SAVE_SECONDS", 0.0)
    in_step(monkeypatch, 3, lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        train(config, tmp_path / "run")
    assert load_file(tmp_path / "run" / "state.safetensors")["optimizer.0.step"] == 2


# killed before anything was saved, or with files missing


def begun(out: Path, config: RunConfig, *files: str) -> Path:
    """A run's folder as a kill left it."""
    out.mkdir(exist_ok=True)
    (out / "config.yaml").write_text(to_yaml(config))
    (out / "log.jsonl").write_text('{"step": 0, "seconds": 0.0}\n{"step": 1, "sec')
    for name in files:
        (out / name).touch()
    return out


@pytest.mark.parametrize("resume", [True, False])
def test_a_run_killed_before_it_saved_anything_begins_at_step_0(
    config: RunConfig, source: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, resume: bool
) -> None:
    out = begun(tmp_path / "run", small_config(source, batch_frames=3))
    assert state_to_resume(out, config, resume=resume) is False
    said = "the run begins at step 0" if resume else "before it saved anything; it begins anew"
    (message,) = caplog.messages
    assert said in message
    with log_from(out / "log.jsonl", 0) as write:
        write({"step": 0})
    assert steps(out) == [0]
    assert len(caplog.messages) == 1


def test_an_empty_folder_can_be_resumed_and_another_one_cannot(config: RunConfig, tmp_path: Path) -> None:
    with only_trainer(tmp_path / "empty"):  # whose lock file may be a dead process'
        assert state_to_resume(tmp_path / "empty", config, resume=True) is False
    with pytest.raises(InputError, match=r"no run to resume there \(no config.yaml\)"):
        state_to_resume(begun(tmp_path, config).parent, config, resume=True)


@pytest.mark.parametrize(
    ("files", "lost", "message"),
    [
        (("model.safetensors",), (), "state.safetensors: missing, .* though model.safetensors is there"),
        (("state.safetensors",), ("config.yaml",), "cannot resume, config.yaml is missing"),
    ],
)
def test_a_run_that_lost_files_is_not_begun_anew(
    config: RunConfig, tmp_path: Path, files: tuple[str, ...], lost: tuple[str, ...], message: str
) -> None:
    out = begun(tmp_path / "run", config, *files)
    for name in lost:
        (out / name).unlink()
    with pytest.raises(InputError, match=message):
        state_to_resume(out, config, resume=True)
    with pytest.raises(InputError, match="holds a run already; add resume=True"):
        state_to_resume(out, config, resume=False)


@pytest.mark.parametrize(
    "change",
    [
        lambda t: {"optimizer.0.exp_avg": t["optimizer.0.exp_avg"][:1]},
        lambda t: {"optimizer.99.step": t["optimizer.0.step"]},
        lambda t: {"optimizer.0.wings": t["optimizer.0.step"]},
        lambda t: {key: None for key in t},
    ],
    ids=["another shape", "of no parameter", "of another kind", "nothing"],
)
def test_a_damaged_optimiser_state_is_refused(change) -> None:  # type: ignore[no-untyped-def]
    parameter = torch.zeros(2, 3)
    tensors = {
        "optimizer.0.step": torch.tensor(1.0),
        "optimizer.0.exp_avg": parameter,
        "optimizer.0.exp_avg_sq": parameter,
    }
    assert optimizer_state(tensors, [parameter], Path("state"), begun=True)[0]["exp_avg"] is parameter
    changed = {key: value for key, value in (tensors | change(tensors)).items() if value is not None}
    with pytest.raises(InputError, match="state: damaged, its optimiser's state does not fit the model"):
        optimizer_state(changed, [parameter], Path("state"), begun=True)


# two in one folder


def test_only_one_process_trains_in_a_folder(config: RunConfig, tmp_path: Path) -> None:
    with (
        only_trainer(tmp_path / "run"),
        pytest.raises(InputError, match=rf"run: process {os.getpid()} on .* is training there"),
    ):
        train(config, tmp_path / "run")
    assert not (tmp_path / "run").exists()


# damaged logs

DAMAGES = {
    "cut short": b'{"step": 3, "posi',
    "no step": b'{"position_loss": 1.0}\n',
    "no object": b"[1, 2]\n",
    "a step in words": b'{"step": "three"}\n',
    "no finite step": b'{"step": 1e999}\n',
    "zeros": bytes(40),
    "not UTF-8": b'{"step": 3, "x": "\xff"}\n',
    "nested without end": b"[" * 100_000,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_line_costs_no_other(tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: str) -> None:
    path = tmp_path / "log.jsonl"
    good = b"".join(b'{"step": %d, "loss": %d}\n' % (n, n) for n in range(3))
    path.write_bytes(good + DAMAGES[damage])
    assert read_curves(path, {"loss": "l"}) == {"l": ([0, 1, 2], [0, 1, 2])}
    assert caplog.messages == [f"note: {path}: 1 damaged lines are left out"]
    with log_from(path, 2) as write:
        write({"step": 3, "loss": 3})
    assert caplog.messages[1:] == [f"note: {path}: 1 damaged lines are dropped"]
    assert path.read_bytes() == good + b'{"step": 3, "loss": 3}\n'


def test_lines_beyond_the_state_doubles_and_a_missing_line_end_are_mended(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text('{"step": 0}\n{"step": 1}\n{"step": 1}\n{"step": 2}\n{"step": 3}')
    with log_from(path, 2) as write:
        write({"step": 3})
    assert steps(tmp_path) == [0, 1, 2, 3]


def test_a_file_that_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text("hello\nworld\n")
    with pytest.raises(InputError, match="not a training log of JSON lines with a step each"):
        read_curves(tmp_path / "log.jsonl", {})
    with pytest.raises(InputError, match="no such file"):
        read_curves(tmp_path / "other.jsonl", {})


# a full disk


def test_a_full_disk_is_one_line_and_the_run_goes_on_afterwards(
    config: RunConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    command = ["train", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "run")]
    with full_disk(3000):
        assert main([*command, "--set", "training.steps=1"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("imgtransfer: error: ")
    assert f"{tmp_path / 'run' / 'state.safetensors'}: cannot be written" in error
    assert "File too large" in error
    assert sorted(path.name for path in (tmp_path / "run").rglob("*")) == [
        "config.yaml",
        "log.jsonl",
        "progress",
    ]
    with (
        full_disk(100),
        pytest.raises(OSError, match="File too large") as failed,
        log_from(tmp_path / "run" / "log.jsonl", 1) as write,
    ):
        write({"step": 2, "text": "x" * 100})
    assert failed.value.filename == str(tmp_path / "run" / "log.jsonl")
    assert main([*command, "--resume", "--set", "training.steps=1"]) == 0
    assert steps(tmp_path / "run") == [0, 1]
    assert load_model(tmp_path / "run")
