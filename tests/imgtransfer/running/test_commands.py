"""predict and fuse over several processes give what one gives, and list what failed."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, load_clip
from imgtransfer.data.store import DataSet
from imgtransfer.training.checkpoint import save_model
from tests.helpers.models import model_for

CLIPS = ("bend", "early", "late")


@pytest.fixture
def here(tmp_path: Path, tube_clip: Clip) -> Path:
    """model.safetensors, and a data set of three clips."""
    save_model(tmp_path / "model.safetensors", model_for(tube_clip))
    data = DataSet.create(tmp_path / "set")
    for name, frames in zip(CLIPS, (slice(0, 6), slice(0, 3), slice(3, 6)), strict=True):
        data.write(f"tube/{name}", tube_clip.slice(frames), split="test")
    return tmp_path


def predict(here: Path, out: str, *options: str) -> int:
    return main(["predict", f"{here}/model.safetensors", f"{here}/set", "--out", f"{here}/{out}", *options])


def test_two_processes_give_what_one_gives(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(max(1, len(os.sched_getaffinity(0)) // 2))  # as each of two processes has
    try:
        for out, options in (("one", []), ("two", ["--workers", "2"])):
            assert predict(here, out, *options) == 0
            assert main(["fuse", f"{here}/{out}", *options]) == 0
    finally:
        torch.set_num_threads(threads)
    for name in CLIPS:
        for file in ("position_only.npz", "fused.npz"):
            one, two = (load_clip(here / out / f"tube__{name}" / file) for out in ("one", "two"))
            np.testing.assert_array_equal(one.garment.vertices, two.garment.vertices)
    capsys.readouterr()
    assert predict(here, "two") == 0
    assert main(["fuse", f"{here}/two"]) == 0
    text = capsys.readouterr().out
    assert text.count("predicted by this model already") == 3
    assert text.count("fused already") == 3
    assert "\nleft     3 of 3 clips, fused with these settings already; --overwrite does them again\n" in text


def test_a_failed_clip_does_not_end_the_others(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "set/tube/early/body_vertices/c/0/0/0").write_bytes(b"junk")
    assert predict(here, "out", "--clip", "tube/[bl]*") == 0
    (here / "out/tube__bend/maps.npz").write_bytes(b"junk")
    capsys.readouterr()
    assert main(["fuse", f"{here}/out", "--workers", "2"]) == 2
    captured = capsys.readouterr()
    assert "failed, 1 of 2:\n  tube__bend: " in captured.out
    assert captured.err.startswith(
        "imgtransfer: error: 1 of 2 clips failed, listed above; the same command tries them again; the first was "
        f"tube__bend: {here}/out/tube__bend/maps.npz: not a readable npz file"
    )
    assert captured.err.count("\n") == 1
    assert (here / "out/tube__late/fused.npz").is_file()
    assert "\nfused    1 clip, 3 frames, " in captured.out


def test_workers_go_with_predictions(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["fuse", "--maps", f"{here}/maps.npz", "--out", f"{here}/out", "--workers", "2"]
    assert main(command) == 2
    assert "--maps is one clip" in capsys.readouterr().err
