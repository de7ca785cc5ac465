"""The paper's configuration, with a tiny checkpoint in place of the encoder's weights."""

from __future__ import annotations

import json
import logging
import re
from pathlib import Path

import pytest

from imgtransfer.cli.main import main
from tests.helpers.hub import checkpoint
from tests.helpers.paths import ROOT


def test_it_runs_on_a_cpu_and_says_what_it_needs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    folder, out = checkpoint(tmp_path / "dino"), tmp_path / "run"
    changes = {
        "network.encoder.name": str(folder),
        "maps.size": "[64, 64]",
        "training.steps": "20",
        "training.batch_frames": "2",
        "training.device": "cpu",
        "training.precision": "float32",
        "data.source": json.dumps(str(ROOT / "configs" / "sample_data" / "tshirt.zarr.zip")),
        "data.validation_frames": "4",
    }
    arguments = ["train", str(ROOT / "configs" / "paper.yaml"), "--out", str(out)]
    assert main([*arguments, *(part for pair in changes.items() for part in ("--set", "=".join(pair)))]) == 0
    needs, later = (one for one in caplog.messages if " on this machine" in one)
    assert re.fullmatch(
        r"networks and batches need about \d+ MB of memory, and 20 steps about \d+ seconds .*", needs
    )
    assert later.startswith("training takes about")  # after the first steps
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == list(range(21))
    assert lines[-1]["position_loss"] < lines[1]["position_loss"]
