"""Which frames each training step sees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

PACK = 4  # frames of one outfit that follow each other


class Order:
    """Which frames a step sees: all once in random order, then all again in another.

    The answer depends on nothing but the arguments, so a resumed run goes on as if it had never stopped.

    Args:
        n_frames: number of frames.
        batch: frames a step.
        seed: of the permutations.
        chunks: numbers of frames that lie together, in order. With them an epoch takes the chunks in random order, and
            mixes the frames of neighbouring ones: good for data that do not fit into memory.
        window: frames, of that order of chunks, that are mixed.
        groups: the frames of each outfit, int64, in place of chunks. With them an epoch takes `PACK` frames of one
            outfit after another, in random order, so that a step encodes few templates.
    """

    def __init__(
        self,
        n_frames: int,
        batch: int,
        seed: int,
        *,
        chunks: Sequence[int] | None = None,
        window: int = 1,
        groups: Sequence[Tensor] | None = None,
    ) -> None:
        self.n_frames, self.batch, self.seed = n_frames, batch, seed
        self._chunks = None if chunks is None else torch.arange(n_frames).split(list(chunks))
        self._window = window
        self._groups = groups
        self._epochs: dict[int, Tensor] = {}

    def frames(self, step: int) -> Tensor:
        """(batch,) int64, the frames of step 0, 1, ..."""
        places = range(step * self.batch, (step + 1) * self.batch)
        return torch.stack([self._epoch(place // self.n_frames)[place % self.n_frames] for place in places])

    def coins(self, step: int) -> Tensor:
        """(batch,) bool, a fair coin for each frame of the step."""
        return torch.rand(self.batch, generator=self._generator(2 * step + 1)) < 0.5

    def step_seed(self, step: int, part: int = 0) -> int:
        """A seed for what else is random in a part of the step, of no other stream of numbers."""
        stream = [self.seed, step, 1, part] if part else [self.seed, step, 1]
        return int(np.random.SeedSequence(stream).generate_state(1)[0])

    def _epoch(self, epoch: int) -> Tensor:
        if epoch not in self._epochs:
            order = self._permutation(self._generator(2 * epoch))
            # A batch may reach over the end of an epoch, so the one before is kept.
            self._epochs = {known: self._epochs[known] for known in self._epochs if known == epoch - 1}
            self._epochs[epoch] = order
        return self._epochs[epoch]

    def _permutation(self, generator: torch.Generator) -> Tensor:
        if self._groups is not None:
            return self._packed(self._groups, generator)
        if self._chunks is None:
            return torch.randperm(self.n_frames, generator=generator)
        walk = torch.randperm(len(self._chunks), generator=generator)
        frames = torch.cat([self._chunks[chunk] for chunk in walk.tolist()])
        mixed = [part[torch.randperm(len(part), generator=generator)] for part in frames.split(self._window)]
        return torch.cat(mixed)

    def _packed(self, groups: Sequence[Tensor], generator: torch.Generator) -> Tensor:
        packs: list[Tensor] = []
        for frames in groups:
            packs += frames[torch.randperm(len(frames), generator=generator)].split(PACK)
        return torch.cat(
            [packs[number] for number in torch.randperm(len(packs), generator=generator).tolist()]
        )

    def _generator(self, stream: int) -> torch.Generator:
        return torch.Generator().manual_seed(
            int(np.random.SeedSequence([self.seed, stream]).generate_state(1)[0])
        )
