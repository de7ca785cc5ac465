"""What stops a training that has gone wrong: a loss that is no number, or far above what it was."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor

from imgtransfer.training.config import TrainingConfig
from render import InputError

LOSSES = ("position_loss", "normal_loss")
WINDOW = 100  # steps whose losses are averaged: single batches differ too much
# Of the least mean so far. A run that overfits some frames may lose a few times as much for a while, and recover.
FACTOR = 8.0


class Diverged(InputError):
    """A training that is no use going on with."""


class LossWatch:
    """Watches the losses of a run.

    Args:
        options: of the training, for what to try next.
        least: mean loss of a window from which on none is far above: numbers near 0 differ by any factor.
    """

    def __init__(self, options: TrainingConfig, least: float = 1e-4) -> None:
        self._options = options
        self._least: dict[str, float] = {}
        self._floor = least
        self._window: dict[str, list[float]] = {name: [] for name in LOSSES}

    def check(self, step: int, losses: Mapping[str, float]) -> None:
        """Take in the losses of step 1, 2, ...

        Raises:
            Diverged: one of them is not finite, or the mean of a window is far above that of an earlier one.
        """
        for name in LOSSES:
            if not math.isfinite(losses[name]):
                raise Diverged(f"training diverged at step {step}: {name} is {losses[name]}; {self.advice()}")
        for name, mean, least in self._add(step, losses):
            if mean > FACTOR * max(least, self._floor):
                raise Diverged(
                    f"training diverged before step {step}: the mean {name} of the last {WINDOW} steps is {mean:.3g}, "
                    f"and it was {least:.3g}; {self.advice()}"
                )

    def resumed(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Take in what the log says of the steps before, so that a stop changes nothing of what is noticed."""
        for entry in entries:
            losses = {name: entry.get(name) for name in LOSSES}
            if all(isinstance(loss, int | float) and math.isfinite(loss) for loss in losses.values()):
                list(self._add(int(entry["step"]), losses))

    def _add(self, step: int, losses: Mapping[str, Any]) -> Iterable[tuple[str, float, float]]:
        """Where a window ends, by loss its mean and the least of the earlier ones."""
        ended = []
        for name, window in self._window.items():
            window.append(float(losses[name]))
            if step % WINDOW == 0:
                mean = sum(window) / len(window)
                if name in self._least:
                    ended.append((name, mean, self._least[name]))
                self._least[name] = min(mean, self._least.get(name, math.inf))
                window.clear()
        return ended

    def advice(self) -> str:
        """What to try next."""
        options = self._options
        tries = [f"a lower training.learning_rate ({options.learning_rate:g} now)"]
        if options.gradient_clip is None:
            tries.append("training.gradient_clip=1")
        if options.warmup_steps < options.steps // 20:
            tries.append(f"longer training.warmup_steps ({options.warmup_steps} now)")
        if options.precision != "float32":
            tries.append("training.precision=float32")
        return f"try {', '.join(tries)}, or look for faulty clips with `imgtransfer inspect`"


def check_finite_weights(tensors: Mapping[str, Tensor], step: int, advice: str) -> None:
    """Raise Diverged where a number that would be saved is not finite."""
    for name, value in tensors.items():
        if value.is_floating_point() and not bool(torch.isfinite(value).all()):
            raise Diverged(f"training diverged at step {step}: {name} is not finite; {advice}")
