"""What is measured of a fitted method beside its errors: robustness to one joint, and errors of roll-outs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from imgtransfer.benchmark.config import Robustness
from imgtransfer.benchmark.measure import RUN, MethodTask
from imgtransfer.benchmark.perturbation import turned_joint, unmoved_vertices
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import clip_refs
from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.checkpoint import load_deformer
from imgtransfer.deformers.common.rates import same_rate
from imgtransfer.deformers.fit import clips_fingerprint
from imgtransfer.deformers.motion_guided.measures import rollout_errors_mm
from imgtransfer.deformers.motion_guided.method import MotionGuided
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.checkpoint import fingerprint as model_fingerprint
from render.files.atomic import written_whole

ALL, UNMOVED = "all", "unmoved"


@dataclass(frozen=True, kw_only=True)
class ProbeTask:
    """A fitted method, and one thing to measure of it on the test clips.

    Args:
        fit: the task that has fitted it.
        robustness: joints to turn; None measures roll-outs instead.
        rollouts: their lengths; None goes to the clip's end.
        seed: of the turns.
    """

    fit: MethodTask
    robustness: Robustness | None = None
    rollouts: tuple[int | None, ...] = ()
    seed: int = 0

    @property
    def kind(self) -> str:
        """What is measured: the section of the configuration."""
        return "rollouts" if self.robustness is None else "robustness"

    @property
    def name(self) -> str:
        """Of garment, method and what is measured."""
        return f"{self.fit.name}, {self.kind}"


def probe(task: ProbeTask) -> dict[str, Any]:
    """Measure it; what stands already, of the same model, clips and settings, is only read.

    Returns:
        Of robustness by joint {"all": mm, "unmoved": mm or None}; of roll-outs mm by length, nothing of other methods.

    Raises:
        InputError: clips without a skeleton.
    """
    torch.set_num_threads(task.fit.threads)
    choice, run = task.fit.data.test, task.fit.folder / RUN
    refs = clip_refs(task.fit.data.source, split=choice.split, names=choice.names, exclude=choice.exclude)
    clips = [ref.load() for ref in refs]
    settings = [task.robustness.model_dump() if task.robustness else None, task.rollouts, task.seed]
    made = fingerprint([model_fingerprint(run), clips_fingerprint(clips), json.dumps(settings)])
    path = task.fit.folder / f"{task.kind}.json"
    try:
        stored = json.loads(path.read_text())
        if stored["made"] == made:
            return dict(stored["values"])
    except (OSError, ValueError, KeyError, TypeError):
        pass  # not there yet, or damaged: it is made again
    deformer = load_deformer(run)
    values: Mapping[str, Any] = (
        rollouts(deformer, clips, task.rollouts)
        if task.robustness is None
        else robustness(deformer, clips, task.robustness, seed=task.seed)
    )
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps({"made": made, "values": values}))
    return dict(values)


def robustness(
    deformer: Deformer, clips: list[Clip], config: Robustness, *, seed: int
) -> dict[str, dict[str, float | None]]:
    """How far the predicted garment moves when one joint is turned, millimetres, means over frames.

    Args:
        clips: to turn joints of. seed: of the turns' axes, which are the same for every method.

    Returns:
        By joint: "all", over all vertices, and "unmoved", over those on a part of the body that does not move (None
        where there are none); a garment that ignores an unrelated joint has 0 there.
    """
    values: dict[str, dict[str, float | None]] = {}
    before = [deformer.predict(replace(clip, garment=None)) for clip in clips]
    for joint in config.joints:
        axes = np.random.default_rng([seed, joint]).normal(size=(config.draws, 3))
        axes *= np.radians(config.angle) / np.linalg.norm(axes, axis=1, keepdims=True)
        every, unmoved = _Mean(), _Mean()
        for clip, garment in zip(clips, before, strict=True):
            for axis in axes:
                turned = turned_joint(clip, joint, axis)
                change = np.linalg.norm(deformer.predict(turned) - garment, axis=-1)
                every.add(change)
                unmoved.add(change[:, unmoved_vertices(clip, turned)])
        values[str(joint)] = {ALL: every.mm, UNMOVED: unmoved.mm}
    return values


def rollouts(deformer: Deformer, clips: list[Clip], lengths: tuple[int | None, ...]) -> dict[str, float]:
    """Errors of roll-outs from true frames by length, mm: means over clips that are long enough, of the fit's rate."""
    if not isinstance(deformer, MotionGuided):
        return {}
    errors: dict[str, list[float]] = {}
    rate = float(deformer.model.fps.item())
    for clip in clips:
        if same_rate(clip.fps, rate):
            for length, value in rollout_errors_mm(deformer, clip, lengths=lengths).items():
                errors.setdefault(length, []).append(value)
    return {length: float(np.mean(values)) for length, values in errors.items()}


class _Mean:
    """Of distances in metres that come in parts."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def add(self, distances: np.ndarray) -> None:
        self._sum += float(distances.sum(dtype=np.float64))
        self._count += distances.size

    @property
    def mm(self) -> float | None:
        return 1e3 * self._sum / self._count if self._count else None
