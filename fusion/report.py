"""What is reported of a fusion, gathered batch by batch: means over the frames, and where the seconds go."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import numpy as np
import torch

from fusion.config import FusionConfig
from fusion.robust.map_fault import FaultLog
from fusion.stages import BatchResult, SolverResult, edge_weights, normal_weights

_WEIGHTS = {"edge": edge_weights, "normal": normal_weights}


class Statistics:
    """Means over frames, of which none is kept.

    Args:
        config: what the batches are solved with.
    """

    def __init__(self, config: FusionConfig) -> None:
        self._config = config
        self._frames = 0
        self._stages = {name: _StageSums() for name in _WEIGHTS}
        self._unseen = 0.0
        self._crossing_frames = 0  # in which crossings were counted
        self._self_crossing = 0.0
        self._crossing: np.ndarray | None = (
            None  # sums of the fractions before and after the clean-up, as below
        )
        self._left_out: float | None = None
        self._faults = FaultLog()
        self._inside: np.ndarray | None = None  # sums of the fractions before and after the clean-up

    def add(self, batch: BatchResult) -> None:
        """Take in a batch."""
        if batch.findings is not None:
            self._left_out = (self._left_out or 0.0) + float(batch.findings.left_out.sum())
            for frame, faults in enumerate(batch.findings.faults, self._frames):
                self._faults.add(frame, faults)
        self._frames += len(batch.vertices)
        for name, solved in batch.stages.items():
            self._stages[name].add(solved)
        self._unseen += float(batch.unseen.sum(dtype=np.float64))
        self._crossing_frames += len(batch.crossing.itself)
        self._self_crossing += float(batch.crossing.itself.sum(dtype=np.float64))
        self._crossing = _added(self._crossing, batch.crossing.body)
        self._inside = _added(self._inside, batch.inside)

    def report(self, *, history: bool) -> dict[str, Any]:
        """Plain numbers by name, see `FusionResult`; with `history` the terms at every iteration, too."""
        terms: dict[str, dict[str, dict[str, float]]] = {}
        totals: dict[str, dict[str, float]] = {}
        iterations: dict[str, float] = {}
        curves: dict[str, dict[str, list[float]]] = {}
        for stage, weigh in _WEIGHTS.items():
            stage_sums = self._stages[stage]
            if not stage_sums.frames:
                continue
            curve = stage_sums.curves()
            weights = weigh(self._config)
            total = np.sum([weights[name] * values for name, values in curve.items()], axis=0)
            ends = {"start": 0, "end": -1}
            terms[stage] = {
                when: {name: float(values[k]) for name, values in curve.items()} for when, k in ends.items()
            }
            totals[stage] = {when: float(total[k]) for when, k in ends.items()}
            iterations[stage] = stage_sums.iterations / stage_sums.frames
            curves[stage] = {name: values.tolist() for name, values in (*curve.items(), ("total", total))}
        report: dict[str, Any] = {
            "solver": self._config.solver,
            "collision_margin_m": self._config.margin_m,
            "frames": self._frames,
            "terms": terms,
            "total": totals,
            "iterations": iterations,
            "unseen_percent": 100 * self._unseen / self._frames,
            "self_crossing_percent": 100 * self._self_crossing / self._crossing_frames,
        }
        if self._left_out is not None:
            report["left_out_percent"] = 100 * self._left_out / self._frames
            report["faults"] = self._faults.report()
        for name, sums, frames in (
            ("penetration_percent", self._inside, self._frames),
            ("crossing_percent", self._crossing, self._crossing_frames),
        ):
            if sums is not None:
                before, after = (100 * sums / frames).tolist()
                report[name] = {"before_clearance": before, "after": after}
        return report | ({"history": curves} if history else {})


def _added(sums: np.ndarray | None, fractions: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray | None:
    """Sums over frames of two fractions, with those of another batch; None where there are none."""
    if fractions is None:
        return sums
    more = np.array([fraction.sum(dtype=np.float64) for fraction in fractions])
    return more if sums is None else sums + more


class _StageSums:
    """Sums over frames of one stage; frames that finished sooner than others stay at their last value."""

    def __init__(self) -> None:
        self.frames = self.iterations = 0
        self._sums: dict[str, np.ndarray] = {}  # (K,) by term, K the most values of any frame so far

    def add(self, solved: SolverResult) -> None:
        self.frames += len(solved.iterations)
        self.iterations += int(solved.iterations.sum())
        for name, values in solved.history.items():
            sums: np.ndarray = values.to("cpu", torch.float64).sum(1).numpy()
            before = self._sums.get(name)
            if before is not None:
                longest = max(len(sums), len(before))
                sums = _extended(before, longest) + _extended(sums, longest)
            self._sums[name] = sums

    def curves(self) -> dict[str, np.ndarray]:
        """(K,) float64 by term: means over all frames."""
        return {name: sums / self.frames for name, sums in self._sums.items()}


def _extended(sums: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([sums, np.full(length - len(sums), sums[-1])])


class Stopwatch:
    """Wall-clock seconds by stage, summed over its turns and over the threads that take them.

    Args:
        device: what computes; work that is under way on a GPU is waited for, so that each stage pays for its own.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self.seconds: dict[str, float] = {}
        self._lock = Lock()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the seconds of the block to stage `name`."""
        self._wait()
        started = time.perf_counter()
        yield
        self._wait()
        with self._lock:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started

    def _wait(self) -> None:
        if self._device.type == "cuda":
            torch.cuda.synchronize(self._device)
