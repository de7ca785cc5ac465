"""Training frames in memory, and which of them each step sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imgtransfer.data.canonical import RootMode, root_frames
from imgtransfer.data.clip import Clip
from render import InputError


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of clips that share a garment and a rest body, in the canonical frame.

    Args:
        garment: (F, N, 3) float32, metres.
        body: (F, V, 3) float32, metres.
        first: a clip without its frames' motion in mind: the template and the rest body.
    """

    garment: Tensor
    body: Tensor
    first: Clip

    @classmethod
    def from_clips(cls, clips: Sequence[Clip], root: RootMode) -> Frames:
        """Move every frame of `clips` to the canonical frame.

        Raises:
            InputError: a clip without garment vertices, or with another garment or rest body than the first.
        """
        first = clips[0]
        garment, body = [], []
        for clip in clips:
            if clip.garment_vertices is None:
                raise InputError(f"{clip.name}: no garment_vertices; training needs the deformed garment")
            for key in ("template_vertices", "garment_faces", "body_rest", "body_faces"):
                if not np.array_equal(getattr(clip, key), getattr(first, key)):
                    raise InputError(
                        f"{clip.name}: its {key} differ from those of {first.name}; one run trains on one garment and "
                        "one rest body, choose clips with data.train.names"
                    )
            frames = root_frames(clip, root)
            garment.append(torch.from_numpy(frames.to_canonical(clip.garment_vertices)))
            body.append(torch.from_numpy(frames.to_canonical(clip.body_vertices)))
        return cls(torch.cat(garment), torch.cat(body), first.slice(slice(0, 1)))

    def __len__(self) -> int:
        return len(self.garment)

    def spread(self, count: int) -> Tensor:
        """Indices of at most `count` frames, evenly spread, int64."""
        return torch.linspace(0, len(self) - 1, min(count, len(self))).round().long()


class Order:
    """Which frames a step sees: all once in random order, then all again in another.

    The answer depends on nothing but the arguments, so a resumed run goes on as if it had never stopped.

    Args:
        n_frames: number of frames.
        batch: frames a step.
        seed: of the permutations.
    """

    def __init__(self, n_frames: int, batch: int, seed: int) -> None:
        self.n_frames, self.batch, self.seed = n_frames, batch, seed
        self._epochs: dict[int, Tensor] = {}

    def frames(self, step: int) -> Tensor:
        """(batch,) int64, the frames of step 0, 1, ..."""
        places = range(step * self.batch, (step + 1) * self.batch)
        return torch.stack([self._epoch(place // self.n_frames)[place % self.n_frames] for place in places])

    def coin(self, step: int) -> bool:
        """A fair coin for the step."""
        return bool(torch.rand((), generator=self._generator(2 * step + 1)) < 0.5)

    def _epoch(self, epoch: int) -> Tensor:
        if epoch not in self._epochs:
            order = torch.randperm(self.n_frames, generator=self._generator(2 * epoch))
            # A batch may reach over the end of an epoch, so the one before is kept.
            self._epochs = {known: self._epochs[known] for known in self._epochs if known == epoch - 1}
            self._epochs[epoch] = order
        return self._epochs[epoch]

    def _generator(self, stream: int) -> torch.Generator:
        return torch.Generator().manual_seed(
            int(np.random.SeedSequence([self.seed, stream]).generate_state(1)[0])
        )
