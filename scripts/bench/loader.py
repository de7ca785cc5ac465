#!/usr/bin/env python
"""What a training step waits for its data: the time in which frames are read, as a fraction of that of the steps.

Steps of configs/demo.yaml in float32 and one thread, on a data set of 4 clips of 96 frames of a tube of cloth about a
body as large as the sample data's.

  share_of_reading_windowed     a quarter of the data fits into the cache: chunks are read again and again
  share_of_reading_cached       all of it fits, later epochs
  step_ms_*                     one whole step, mean
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from unittest.mock import patch

import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.config.loader import load_config
from imgtransfer.data.store import DataSet
from imgtransfer.training.config import RunConfig
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from scripts.bench.clips import clip_on_grid
from scripts.bench.measuring import Results, command

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "demo.yaml"
CLIPS = 4


def measure(quick: bool) -> Results:
    """All numbers."""
    sizes = ((16, 10), (14, 12), 40) if quick else ((54, 36), (58, 48), 96)
    clip = clip_on_grid(*sizes)
    numbers = len(clip.template.vertices) + len(clip.body.rest)
    whole_gb = 1e-9 * 4 * 3 * numbers * CLIPS * clip.n_frames
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "set.zarr"
        data = DataSet.create(path)
        for number in range(CLIPS):
            data.write(f"tube/{number:02d}", clip, split="train")
        for case, cache_gb in (("windowed", whole_gb / 4), ("cached", 2 * whole_gb)):
            changes = [f"data.source={path}", "data.validation={split: train}", f"data.cache_gb={cache_gb}"]
            changes += ["training.threads=1", "training.precision=float32"]
            changes += ["maps.size=[32, 32]", "training.batch_frames=2"] if quick else []
            trainer = Trainer(load_config(RunConfig, CONFIG, changes))
            if case == "cached":
                trainer.train_frames.read(torch.arange(len(trainer.train_frames)))
            found |= {f"{key}_{case}": value for key, value in _steps(trainer, 2 if quick else 12).items()}
            print(f"{case} done", file=sys.stderr)
    return {"loader": found}


def _steps(trainer: Trainer, count: int) -> dict[str, float]:
    """So many steps after a first one."""
    trainer.train_step()
    waited, read = 0.0, Frames.read

    def timed(frames: Frames, index: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        nonlocal waited
        started = time.perf_counter()
        try:
            return read(frames, index)
        finally:
            waited += time.perf_counter() - started

    started = time.perf_counter()
    with patch.object(Frames, "read", timed):
        for _ in range(count):
            trainer.train_step()
    seconds = time.perf_counter() - started
    return {"share_of_reading": waited / seconds, "step_ms": 1000 * seconds / count}


if __name__ == "__main__":
    command(__doc__, measure)
