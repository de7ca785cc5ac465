#!/usr/bin/env python
"""`imgtransfer predict` and `fuse` together, float32, in one process: frames a second, by stage, and peak memory.

By default the shipped model on a test clip of the sample shirt, with two threads on at most two cores;
`--model PATH`, `--source PATH`, `--clip NAME` and `--threads N` choose others. Everything counts but the start of the
process and the reading of the model.

  frames_per_second       predict and fuse together; predict_, fuse_: of each
  *_ms_STAGE              a frame, wall clock, summed over the threads, so that they can be more than the whole
  predict_ms_setup        what is made once a clip, such as the projection of the body, spread over the frames
  predict_ms_images       of the posed body; predict_ms_guess: the first guess from them
  predict_ms_vertices     read from the position maps
  predict_ms_rest         what no stage names: canonical frames, unit normals, encoding, checks
  fuse_ms_setup, ...      as the fusion's report names its stages
  memory_mb_N             resident memory at its peak of predict and fuse, processes of their own, for N frames: the
                          larger of the two
  memory_ratio            of the longer clip to the shorter, which has a fifth of the frames
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any
from unittest.mock import patch

import torch

# This folder's own fusion.py and render.py must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fusion import FusionConfig
from fusion.initialise import InitialWeights
from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.source import ClipRef, clip_refs
from imgtransfer.network import TransferModel
from imgtransfer.network.base import BodyGuess
from imgtransfer.network.maps import BodyImager
from imgtransfer.network.model import Predictor
from imgtransfer.pipeline import predict
from imgtransfer.pipeline.folder import REPORT_FILE
from imgtransfer.pipeline.fuse import FuseOptions
from imgtransfer.pipeline.fuse_task import FuseTask, fuse_clip
from imgtransfer.pipeline.predict import save_prediction
from imgtransfer.training.checkpoint import load_model
from scripts.bench.measuring import Results, command
from scripts.bench.memory import peak_mb

ROOT = Path(__file__).resolve().parents[2]
MODEL, SOURCE = ROOT / "configs/pretrained", ROOT / "configs/sample_data/tshirt.zarr.zip"
MEMORY_FRAMES = 48  # of the shorter clip: three batches of a prediction
LONGER = 5


def measure(
    quick: bool, *, model: Path = MODEL, source: Path = SOURCE, clip: str | None = None, threads: int = 2
) -> Results:
    """Speed and memory of a model's file or folder on a clip, the first of the split `test` if it is not named."""
    before = torch.get_num_threads()
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else None
    if cores:
        os.sched_setaffinity(0, sorted(cores)[:threads])
    torch.set_num_threads(threads)
    try:
        split, names = (None, [clip]) if clip else ("test", None)
        whole = clip_refs(source, split=split, names=names)[0].reader().clip()
        used = whole.slice(slice(0, 4)) if quick else whole
        return {"speed": _speed(model, used), "memory": _memory(model, used, quick)}
    finally:
        torch.set_num_threads(before)
        if cores:
            os.sched_setaffinity(0, cores)


class _Stages:
    """Seconds by stage, of functions that are replaced by timed ones inside a block."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._lock = Lock()

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, whose time is added to the stage's."""

        def replaced(*args: Any, **kwargs: Any) -> Any:
            started = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                self._add(name, started)

        return replaced

    def read(self, parts: Callable[..., Iterator[Clip]]) -> Callable[..., Iterator[Clip]]:
        """A reader's `parts`, whose reading is a stage."""

        def replaced(*args: Any) -> Iterator[Clip]:
            iterator = parts(*args)
            while True:
                started = time.perf_counter()
                part = next(iterator, None)
                self._add("reading", started)
                if part is None:
                    return
                yield part

        return replaced

    def writer(self, name: str, opened: Callable[..., AbstractContextManager[Any]]) -> Callable[..., Any]:
        """The same context manager, the time of whose yielded function is added to the stage's."""

        @contextmanager
        def replaced(path: Path) -> Iterator[Callable[..., Any]]:
            with opened(path) as add:
                yield self.timed(name, add)

        return replaced

    def _add(self, name: str, started: float) -> None:
        with self._lock:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started


def _speed(path: Path, clip: Clip) -> dict[str, float]:
    """Frames a second and milliseconds a frame, after a run of a few frames: first calls compile and fill caches."""
    model, frames = load_model(path), clip.n_frames
    with tempfile.TemporaryDirectory() as name:
        for count in (min(frames, 4), frames):
            source, folder = Path(name) / f"walk{count}.npz", Path(name) / f"out{count}"
            _write(source, clip, count)
            predicted, stages = _predicted(model, clip_refs(source)[0], folder)
            started = time.perf_counter()
            report = _fused(folder)
            fused = time.perf_counter() - started
    return {
        "frames": frames,
        "frames_per_second": frames / (predicted + fused),
        "predict_frames_per_second": frames / predicted,
        "fuse_frames_per_second": frames / fused,
        **{f"predict_ms_{stage}": 1000 * seconds / frames for stage, seconds in stages.items()},
        **{f"fuse_ms_{stage}": 1000 * seconds / frames for stage, seconds in report["stage_seconds"].items()},
    }


def _predicted(model: TransferModel, source: ClipRef, folder: Path) -> tuple[float, dict[str, float]]:
    """Seconds of a prediction, and by stage."""
    stages, reader = _Stages(), source.reader()
    replaced: list[tuple[Any, str, Callable[..., Any]]] = [
        (owner, attribute, stages.timed(stage, getattr(owner, attribute)))
        for owner, attribute, stage in (
            (TransferModel, "predictor", "setup"),
            (BodyImager, "__call__", "images"),
            (BodyGuess, "__call__", "guess"),
            (Predictor, "_images", "networks"),
            (InitialWeights, "__call__", "vertices"),
            (Predictor, "shown", "shown"),
            (Predictor, "predicted", "predicted"),
            (predict, "maps_of", "maps"),
        )
    ]
    replaced.append((predict, "written_maps", stages.writer("writing_maps", predict.written_maps)))
    replaced.append((predict, "written_clip", stages.writer("writing_clip", predict.written_clip)))
    replaced.append((type(reader), "parts", stages.read(type(reader).parts)))
    started = time.perf_counter()
    with ExitStack() as stack:
        for owner, attribute, call in replaced:
            stack.enter_context(patch.object(owner, attribute, call))
        save_prediction(folder, model, reader, record={})
    whole, seconds = time.perf_counter() - started, stages.seconds
    rest = sum(seconds.pop(name) for name in ("shown", "predicted", "maps"))
    rest -= seconds["images"] + seconds["networks"]
    if "guess" in seconds:
        seconds["images"] -= seconds["guess"]
    return whole, seconds | {"rest": rest}


def _fused(folder: Path) -> dict[str, Any]:
    """Fuse a prediction, and return the report."""
    fuse_clip(FuseTask(folder=folder, options=FuseOptions(config=FusionConfig())))
    report: dict[str, Any] = json.loads((folder / REPORT_FILE).read_text())
    return report


def _memory(model: Path, clip: Clip, quick: bool) -> dict[str, float]:
    """Megabytes of both commands at their peak, for a clip and one that is `LONGER` times as long."""
    shorter = 2 if quick else MEMORY_FRAMES
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        for frames in (shorter, LONGER * shorter):
            source = Path(name) / f"walk{frames}.npz"
            out = Path(name) / f"out{frames}"
            _write(source, clip, frames)
            commands = (["predict", str(model), str(source), "--out", str(out)], ["fuse", str(out)])
            peaks = [peak_mb([sys.executable, "-m", "imgtransfer.cli.main", *words]) for words in commands]
            found[f"memory_mb_{frames}"] = max(peaks)
    found["memory_ratio"] = found[f"memory_mb_{LONGER * shorter}"] / found[f"memory_mb_{shorter}"]
    return found


def _write(path: Path, clip: Clip, frames: int) -> None:
    """Write so many frames of a clip, which begins again where it ends."""
    with written_clip(path) as add:
        for first in range(0, frames, clip.n_frames):
            add(clip.slice(slice(0, min(clip.n_frames, frames - first))))


def _options() -> tuple[dict[str, Any], list[str]]:
    """The arguments of `measure` on the command line, and the words that are left for `command`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--model", type=Path, default=MODEL)
    parser.add_argument("--source", type=Path, default=SOURCE)
    parser.add_argument("--clip")
    parser.add_argument("--threads", type=int, default=2)
    options, words = parser.parse_known_args()
    return vars(options), words


if __name__ == "__main__":
    given, rest = _options()
    command(__doc__, partial(measure, **given), rest)
