#!/usr/bin/env python
"""Reading a data set as training does: frames a second with and without caching, beside what a training step needs.

A data set of a tube of cloth about a body, as large as the sample data's (1,944 and 2,786 vertices) and as the public
T-shirt on an SMPL body (4,400 and 6,890), 12 clips of 96 frames on the grid that simulation rounds to. One thread.

  write_frames_per_s            clips written, compressed and checked
  clip_frames_per_s             whole clips read one after another
  frames_per_s_uncached         frames in random order, nothing kept: each reads a chunk of 32
  frames_per_s_windowed         a quarter of the data fits into the cache; chunks in random order, their frames mixed
  frames_per_s_first            everything fits, first epoch: each chunk is read once
  frames_per_s_cached           everything fits, later epochs
  ratio_cached_to_uncached      how many times as many frames a second caching brings
  chunk_reads_per_chunk_*       how often a chunk is read in an epoch
  megabytes_per_frame           on disk; of float32 numbers in memory
  trainer_frames_per_s          frames that one step of configs/demo.yaml takes in, a second (one thread)
  share_of_step_*               time to read a batch over that of a step
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.config.loader import load_config
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from imgtransfer.training.config import RunConfig
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from scripts.bench import shapes
from scripts.bench.clips import clip_on_grid
from scripts.bench.measuring import Results, command, interleaved

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "demo.yaml"
CASES = {  # garment and body, vertices around and along
    "sample": ((54, 36), (58, 48)),
    "public": (shapes.SMALL, shapes.SMPL_SIZED),
}
BATCH = 8


def measure(quick: bool) -> Results:
    """All numbers, by the size of the meshes."""
    cases = {"tiny": ((16, 10), (14, 12))} if quick else CASES
    results: Results = {}
    for name, (garment, body) in cases.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "set.zarr"
            clip = clip_on_grid(garment, body, 40 if quick else 96)
            results[name] = _store(path, clip, clips=2 if quick else 12, rounds=1 if quick else 5)
            results[name] |= _trainer(path, quick)
        found = results[name]
        for way in ("uncached", "windowed", "cached"):
            found[f"share_of_step_{way}"] = found["trainer_frames_per_s"] / found[f"frames_per_s_{way}"]
    return results


def _store(path: Path, clip: Clip, *, clips: int, rounds: int) -> dict[str, float]:
    data = DataSet.create(path)
    started = time.perf_counter()
    for number in range(clips):
        data.write(f"tube/{number:02d}", clip, split="train")
    written = time.perf_counter() - started
    total = clips * clip.n_frames
    frame_bytes = 12 * (len(clip.template.vertices) + len(clip.body.rest))
    random = torch.from_numpy(np.random.default_rng(0).permutation(total))[: 16 * BATCH].split(BATCH)

    def frames(limit: float) -> Frames:
        return Frames([ref.reader() for ref in clip_refs(path)], "root", int(limit))

    uncached, all_kept = frames(1), frames(1e12)
    windowed = frames(total * frame_bytes / 4)
    order = windowed.order(BATCH, seed=0)
    steps = total // BATCH

    def epoch(of: Frames) -> float:
        started = time.perf_counter()
        for step in range(steps):
            of.read(order.frames(step))
        return time.perf_counter() - started

    first = epoch(all_kept)
    windowed_seconds = epoch(windowed)
    times = interleaved(
        {
            "uncached": lambda: [uncached.read(index) for index in random],
            "cached": lambda: [all_kept.read(index) for index in random],
            "clips": lambda: [data.read(name) for name in data.names()[:2]],
        },
        rounds=rounds,
    )
    sampled = sum(len(index) for index in random)
    stored = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    return {
        "write_frames_per_s": total / written,
        "clip_frames_per_s": 2 * clip.n_frames / times.s("clips"),
        "frames_per_s_uncached": sampled / times.s("uncached"),
        "frames_per_s_windowed": steps * BATCH / windowed_seconds,
        "frames_per_s_first": steps * BATCH / first,
        "frames_per_s_cached": sampled / times.s("cached"),
        "ratio_cached_to_uncached": times.ratio("uncached", "cached"),
        "chunk_reads_per_chunk_windowed": windowed.chunk_reads / windowed.n_chunks,
        "megabytes_per_frame_disk": stored / total / 1e6,
        "megabytes_per_frame_memory": frame_bytes / 1e6,
    }


def _trainer(path: Path, quick: bool) -> dict[str, float]:
    changes = ["maps.size=[32, 32]"] if quick else []
    source = [f"data.source={path}", "data.validation={split: train}", f"training.batch_frames={BATCH}"]
    trainer = Trainer(load_config(RunConfig, CONFIG, [*changes, *source, "training.threads=1"]))
    times = interleaved({"step": trainer.train_step}, rounds=1 if quick else 5)
    return {"trainer_frames_per_s": BATCH / times.s("step")}


if __name__ == "__main__":
    command(__doc__, measure)
