"""The number type of a training: chosen by what this device does faster, and no part of what makes a run that run."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Literal

import pytest
import torch

from imgtransfer.config.loader import load_config
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.report.logs import read_curves
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.precision import Precision, Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.run_folder import may_go_on
from imgtransfer.training.trainer import Trainer
from tests.helpers.paths import ROOT
from tests.helpers.training import small_config

CPU = torch.device("cpu")
# What a processor with AVX2 and nothing newer has: these keep oneDNN and PyTorch from using more.
OLD_PROCESSOR = {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"}


@pytest.mark.parametrize(
    ("ratio", "wanted", "words"),
    [
        (0.528, "bfloat16", "0.53 times"),
        (0.9, "bfloat16", "0.9 times"),
        (0.95, "float32", "0.95 times"),
        (1.0, "float32", "1 times"),
        (110.4, "float32", "110 times"),
    ],
)
def test_auto_takes_bfloat16_where_it_saves_a_tenth_of_the_time(
    ratio: float, wanted: str, words: str
) -> None:
    chosen = choose_precision("auto", lambda: ratio)
    assert (chosen.name, chosen.ratio) == (wanted, ratio)
    assert str(chosen) == f"number type: {wanted} (bfloat16 takes {words} as long as float32 on this device)"
    assert chosen.log_entry() == {"precision": wanted, "bfloat16_to_float32": ratio}


def test_what_is_asked_for_by_name_is_done_with_a_warning_where_it_is_slower() -> None:
    slow, fast = (choose_precision("bfloat16", lambda ratio=ratio: ratio) for ratio in (12.3, 0.5))  # type: ignore[misc]
    assert slow.name == fast.name == "bfloat16"
    assert str(slow).startswith(
        "warning: training.precision is bfloat16, but bfloat16 takes 12 times as long"
    )
    assert "warning" not in str(fast)


def test_float32_by_name_measures_nothing() -> None:
    def measure() -> float:
        raise AssertionError("measured")

    assert choose_precision("float32", measure) == Precision("float32", asked=True)


def test_a_processor_that_emulates_bfloat16_computes_in_float32() -> None:
    program = (
        "import torch; from imgtransfer.training.precision import *;"
        "ratio = bfloat16_ratio(torch.device('cpu'), Workload());"
        "print(torch.backends.cpu.get_cpu_capability(), ratio, choose_precision('auto', lambda: ratio).name)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | OLD_PROCESSOR,
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    capability, ratio, name = done.stdout.split()
    assert (capability, name) == ("AVX2", "float32")
    assert float(ratio) > 2


def test_measuring_changes_neither_random_numbers_nor_threads() -> None:
    before = torch.get_rng_state(), torch.get_num_threads()
    assert 0 < bfloat16_ratio(CPU, Workload(images=2, rows=2, columns=2, dim=64)) < 1000
    assert torch.equal(torch.get_rng_state(), before[0])
    assert torch.get_num_threads() == before[1]


def test_the_workload_is_the_runs_own_within_what_a_cpu_does_in_a_moment() -> None:
    vit_b = ["network.encoder={kind: vit, patch: 16, dim: 768, depth: 12, heads: 12}"]
    demo, paper = (
        load_config(RunConfig, ROOT / "configs" / f"{name}.yaml", changes)
        for name, changes in (("demo", []), ("paper", vit_b))
    )
    of_demo, of_paper = (
        Workload.of(config.maps, config.network, config.training.batch_frames) for config in (demo, paper)
    )
    assert of_demo == Workload(images=16, rows=8, columns=8, dim=128)
    assert of_paper == Workload(images=16, rows=16, columns=16, dim=768)
    assert of_demo.for_a_cpu() == Workload(images=4, rows=8, columns=8, dim=128)
    assert of_paper.for_a_cpu() == Workload(images=1, rows=8, columns=8, dim=256)


@pytest.mark.parametrize("name", ["demo", "external", "general", "pretrain", "paper"])
def test_shipped_configurations_leave_the_number_type_to_the_machine(name: str) -> None:
    assert load_config(RunConfig, ROOT / "configs" / f"{name}.yaml").training.precision == "auto"


def test_a_run_goes_on_in_another_number_type(
    tube_clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    for name in ("first", "second_test"):
        save_clip(tmp_path / f"{name}.npz", tube_clip)
    before, after = (small_config(tmp_path, precision=name) for name in ("float32", "bfloat16"))
    original = Trainer.train_step

    def interrupted(self: Trainer) -> dict[str, float]:
        if self.step == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return original(self)

    monkeypatch.setattr(Trainer, "train_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(before, tmp_path / "run")
    monkeypatch.undo()
    assert "number type: float32, as asked for" in caplog.text
    train(after, tmp_path / "run", resume=True)
    ratio = bfloat16_ratio(CPU, Workload.of(after.maps, after.network, after.training.batch_frames))
    assert str(choose_precision("bfloat16", lambda: ratio)) in caplog.text
    lines = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == list(range(7))
    assert {line["step"]: line["precision"] for line in lines if "precision" in line} == {
        0: "float32",
        5: "bfloat16",
    }
    curves = read_curves(tmp_path / "run" / "log.jsonl", {"position_loss": "loss", "position_mm": "error"})
    assert curves["loss"][0] == [1, 2, 3, 4, 5, 6]
    assert curves["error"][0] == [0, 3, 6]
    assert load_config(RunConfig, tmp_path / "run" / "config.yaml") == after


@pytest.mark.parametrize("key", ["precision", "device", "threads"])
def test_what_is_the_machines_makes_no_other_run(
    tmp_path: Path, key: Literal["precision", "device", "threads"]
) -> None:
    other = {"precision": "bfloat16", "device": "cpu", "threads": 2}[key]
    before = small_config(tmp_path)
    assert may_go_on(before, small_config(tmp_path, **{key: other}))
    assert not may_go_on(before, small_config(tmp_path, **{key: other}, learning_rate=0.5))
