"""A fusion of frames that are fetched when their turn comes, and handed on when they are solved."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import torch

from fusion.config import FusionConfig
from fusion.inputs import FusionInputs
from fusion.parallel import one_torch_thread
from fusion.pipeline import Piece, Pipeline, frames_at_once, usable_threads
from fusion.statistics import Statistics
from fusion.stopwatch import Stopwatch
from render.imager import TemplateImager

#: Given how many frames make a batch, all frames in order, so many at a time; the last batch may be smaller.
Batches = Callable[[int], Iterator[FusionInputs]]


def fuse_batches(
    imager: TemplateImager,
    n_frames: int,
    batches: Batches,
    take: Callable[[Piece], object],
    *,
    config: FusionConfig,
    device: str | torch.device = "cpu",
    weighted: bool,
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Solve all frames; memory is needed for a few batches, not for the clip.

    With `weight_temporal`, which makes one problem of all frames, one batch holds them all.

    Args:
        imager: of the garment's template, with the cameras of the maps.
        n_frames: how many frames `batches` yields in all.
        batches: fetches them.
        take: gets every solved batch, in order.
        config, device, history, progress: as for `fuse`.
        weighted: whether any pixel's confidence in any frame is not 1.

    Returns:
        The report, see `FusionResult`.

    Raises:
        InputError: see `fuse`; frames that came before have been handed on by then.
    """
    device, started = torch.device(device), time.perf_counter()
    watch, statistics = Stopwatch(device), Statistics(config)
    with one_torch_thread():
        threads = usable_threads(config, device, n_frames)
        coming = batches(frames_at_once(config, threads, n_frames))
        first = next(coming)
        with watch.stage("setup"):
            pipeline = Pipeline(imager, first, config, device, threads=threads, weighted=weighted)
        for piece in pipeline.pieces(itertools.chain([first], coming), watch):
            statistics.add(piece)
            take(piece)
            if progress is not None:
                progress(len(piece.vertices))
    seconds = time.perf_counter() - started
    return statistics.report(history=history) | {
        "seconds": seconds,
        "seconds_per_frame": seconds / n_frames,
        "stage_seconds": watch.seconds,
    }


def slices(n_frames: int, size: int) -> Iterator[slice]:
    """All frames, `size` at a time."""
    return (slice(first, min(first + size, n_frames)) for first in range(0, n_frames, size))
