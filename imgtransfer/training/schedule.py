"""The learning rate over a run."""

from __future__ import annotations

import math

from imgtransfer.training.config import TrainingConfig


def learning_rate(options: TrainingConfig, step: int) -> float:
    """The rate of step 0, 1, ...: a linear warm-up, then constant or half a cosine down to 0 at the end."""
    if step < options.warmup_steps:
        return options.learning_rate * (step + 1) / options.warmup_steps
    if options.schedule == "constant":
        return options.learning_rate
    done = (step - options.warmup_steps) / max(options.steps - options.warmup_steps, 1)
    return options.learning_rate * (1 + math.cos(math.pi * done)) / 2
