"""What every stage of a fit does: draw windows and some of their frames, and descend by the settings given for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.descent_config import DescentConfig
from imgtransfer.deformers.common.windows import Batch, Windows
from imgtransfer.deformers.descent import descend


class Draw:
    """The windows of each step, from the seed and the step's number alone.

    Args:
        lengths: frames of each clip.
        config: of the stage.
        seed: of the stage.
    """

    def __init__(self, lengths: Sequence[int], config: DescentConfig, seed: int) -> None:
        self._windows = Windows(lengths, warm_up=config.warm_up_frames, length=config.window_frames)
        self._count, self._seed = config.windows, seed

    def __call__(self, step: int) -> Batch:
        """A batch (B, L)."""
        return self._windows.draw(self._count, np.random.default_rng((self._seed, step)))

    def with_frames(self, step: int, most: int) -> tuple[Batch, Tensor]:
        """The same, and places (F,) in it, as if it had one axis, of so many of its frames that count, or all."""
        batch = self(step)
        counted = np.flatnonzero(batch.counted.flatten().numpy())
        chosen = np.random.default_rng((self._seed, step, 1)).permutation(counted)[:most]
        return batch, torch.from_numpy(np.sort(chosen))


def fit_stage(
    module: nn.Module,
    loss: Callable[[int], dict[str, Tensor]],
    stage: str,
    config: DescentConfig,
    folder: FitFolder,
) -> None:
    """`descend` with a stage's settings."""
    descend(
        module,
        loss,
        stage=stage,
        steps=config.steps,
        learning_rate=config.rate(),
        folder=folder,
        weight_decay=config.weight_decay,
        gradient_clip=config.gradient_clip,
    )
