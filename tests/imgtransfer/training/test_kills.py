"""A training in two processes that is killed at random moments ends with the weights of one that never was."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from imgtransfer.config.loader import to_yaml
from tests.helpers.launching import kill_all, launched, wait_for_entry
from tests.helpers.training import small_config

KILLS = 20
WINDOW = 3.0  # seconds after the first entry of the log within which the kill comes


@pytest.mark.long
def test_twenty_kills_change_no_weight(source: Path, tmp_path: Path) -> None:
    options = {
        "steps": 400,
        "batch_frames": 1,
        "ema": 0.9,
        "learning_rate": 1e-3,
        "validate_every_steps": 40,
        "checkpoint_every_steps": 3,
        "keep_checkpoints": 2,
    }
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    (tmp_path / "run.yaml").write_text(to_yaml(small_config(source, accumulate=2, **options)))
    # In as many processes: the order in which gradients are added up changes their last bits.
    unbroken = launched(2, "train", str(tmp_path / "run.yaml"), "--out", str(whole), port=29699)
    _, said = unbroken.communicate(timeout=900)
    assert unbroken.returncode == 0, said[-3000:]
    words = ["train", str(tmp_path / "run.yaml"), "--out", str(killed)]
    moments = np.random.default_rng(0).uniform(0, WINDOW, KILLS)
    kills = 0
    for number, moment in enumerate(moments):
        resume = ["--resume"] if (killed / "config.yaml").exists() else []
        process = launched(2, *words, *resume, port=29700 + number)
        if wait_for_entry(process, killed / "log.jsonl"):
            time.sleep(moment)
        ended = process.poll() is not None
        kill_all(process)
        if ended:
            break
        kills += 1
    assert kills >= KILLS // 2, "the training ended before it was killed often enough"
    last = launched(2, *words, "--resume", port=29800)
    _, err = last.communicate(timeout=900)
    assert last.returncode == 0, err[-3000:]
    for file in ("state.safetensors", "model.safetensors"):
        wanted, found = load_file(whole / file), load_file(killed / file)
        assert wanted.keys() == found.keys()
        assert all(torch.equal(wanted[key], found[key]) for key in wanted), f"{file} after {kills} kills"
