"""A fusion of frames that are fetched when their turn comes, and handed on when they are solved."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from fusion.batching import frames_at_once, usable_threads
from fusion.config import FusionConfig
from fusion.frame_solver import FrameSolver
from fusion.grown_maps import GrownMaps
from fusion.inputs import FusionInputs
from fusion.parallel import one_torch_thread
from fusion.report import Statistics, Stopwatch
from fusion.smoothing import TemporalSmoothing, period_in_frames
from fusion.stages import BatchResult
from render.maps.imager import TemplateImager
from render.threads import one_blas_thread

#: Gets every batch that is solved, in order.
Take = Callable[[BatchResult], object]


@dataclass(frozen=True, eq=False)
class FrameStream:
    """Frames that are fetched when their turn comes.

    Args:
        n_frames: how many `batches` yields in all.
        batches: given how many frames make a batch, all frames in order, so many at a time, each batch as
            `fusion.input_checks.checked` returns it; the last one may be smaller.
        weighted: whether any pixel's confidence in any frame is not 1.
        fps: frames a second, None where nobody knows.
        grown: which pixels of the position maps have grown from others; None: none.
    """

    n_frames: int
    batches: Callable[[int], Iterator[FusionInputs]]
    weighted: bool
    fps: float | None = None
    grown: GrownMaps | None = None


@one_blas_thread()
def fuse_batches(
    imager: TemplateImager,
    frames: FrameStream,
    take: Take,
    config: FusionConfig | None = None,
    *,
    device: str | torch.device = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Solve all frames; memory is needed for a few batches, not for the clip.

    With `smooth_time_s`, vertices and obstacles of the frames within four of its periods on either side are kept, too.

    Args:
        imager: of the garment's template, with the cameras of the maps.
        frames: what is fused.
        take: gets every solved batch, in order.
        config, device, history, progress: as for `fuse`.

    Returns:
        The report, see `FusionResult`.

    Raises:
        InputError: see `fuse`; frames that came before have been handed on by then.
    """
    config, device, started = config or FusionConfig(), torch.device(device), time.perf_counter()
    watch = Stopwatch(device)
    with one_torch_thread():
        threads = usable_threads(config, device, frames.n_frames)
        period = period_in_frames(config, frames.fps) if config.smooth_time_s else None
        size = frames_at_once(
            config, device, threads=threads, n_frames=frames.n_frames, n_vertices=len(imager.mesh.vertices)
        )
        coming = frames.batches(size)
        first = next(coming)
        config = config.on_skin(first.contact_offset_m)
        statistics = Statistics(config)
        with watch.stage("setup"):
            solver = FrameSolver(
                imager,
                first,
                config,
                device,
                threads=threads,
                weighted=frames.weighted,
                grown=frames.grown,
            )
        batches: Iterator[FusionInputs] = itertools.chain([first], coming)
        if period is None:
            solved, smoothing = solver.solve_all(batches, watch), None
        else:
            assert frames.fps is not None  # `period_in_frames` saw to it
            smoothing = TemporalSmoothing(period, solver.settled, frames.fps)
            solved = smoothing.smoothed(solver.solve_all(smoothing.noting(batches), watch))
        for batch in solved:
            statistics.add(batch)
            take(batch)
            if progress is not None:
                progress(len(batch.vertices))
    seconds = time.perf_counter() - started
    report = statistics.report(history=history) | ({} if smoothing is None else smoothing.report())
    return report | {
        "seconds": seconds,
        "seconds_per_frame": seconds / frames.n_frames,
        "stage_seconds": watch.seconds,
    }


def slices(n_frames: int, size: int) -> Iterator[slice]:
    """All of `n_frames` frames in order, `size` at a time; the last slice may be shorter."""
    return (slice(first, min(first + size, n_frames)) for first in range(0, n_frames, size))


@dataclass(frozen=True, eq=False)
class FusionResult:
    """Vertices recovered from maps.

    Args:
        vertices: (T, N, 3) float32, metres.
        initial: (T, N, 3) float32, metres, before any optimisation.
        report: plain numbers by name, means over frames: `solver`; `collision_margin_m`, as it was used;
            `terms` at the start and end of each stage (unweighted, lengths in metres) and `total`, their weighted sum;
            `iterations` by stage;
            `unseen_percent` of the vertices, `penetration_percent` before and after the clean-up (where there is a
            body or a garment beneath), `crossing_percent` (with a body) before and after it, `self_crossing_percent`,
            both of every fourth frame; `seconds`, `seconds_per_frame`, `stage_seconds` (of all frames and threads
            together: setup, start, edge, normal, clearance, crossings); `acceleration_m_s2`, mean over vertices and
            inner frames, before and after smoothing (where there is any); `history` on request: by stage and term
            (or "total") a list with one value an iteration, from before the first to after the last.
    """

    vertices: np.ndarray
    initial: np.ndarray
    report: dict[str, Any]


def collected(solve: Callable[[Take], dict[str, Any]]) -> FusionResult:
    """All frames of a fusion: `solve` hands its batches on and returns the report."""
    batches: list[tuple[np.ndarray, np.ndarray]] = []
    report = solve(lambda batch: batches.append((batch.vertices, batch.initial)))
    vertices, initial = (np.concatenate(parts) for parts in zip(*batches, strict=True))
    return FusionResult(vertices, initial, report)
