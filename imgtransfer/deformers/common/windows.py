"""Pieces of clips that recurrent networks are fitted to, each with frames before it for the network to settle in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Batch:
    """Some windows of the frames of all clips, which are numbered one clip after the other.

    Args:
        frames: (B, L) int64. Before a clip begins its first frame stands, after its end the last.
        counted: (B, L) bool: frames that the loss is of, not those for settling in or after the end.
    """

    frames: Tensor
    counted: Tensor


class Windows:
    """Windows of clips of any lengths.

    Args:
        lengths: frames of each clip.
        warm_up: frames before those that count.
        length: frames that count; a shorter clip gives a shorter window.
    """

    def __init__(self, lengths: Sequence[int], *, warm_up: int, length: int) -> None:
        self._lengths = np.asarray(lengths)
        self._first = np.cumsum([0, *lengths[:-1]])
        self._warm_up, self._length = warm_up, min(length, max(lengths))

    def draw(self, count: int, generator: np.random.Generator) -> Batch:
        """Windows drawn at random, so that every frame of every clip is nearly as likely as the others."""
        clips = generator.choice(len(self._lengths), count, p=self._lengths / self._lengths.sum())
        starts = generator.integers(0, np.maximum(self._lengths[clips] - self._length, 0) + 1)
        steps = np.arange(self._warm_up + self._length)
        own = starts[:, None] - self._warm_up + steps
        last = self._lengths[clips][:, None] - 1
        counted = (steps >= self._warm_up) & (own <= last)
        frames = self._first[clips][:, None] + own.clip(0, last)
        return Batch(torch.from_numpy(frames), torch.from_numpy(counted))


def warmed_up(features: Tensor, frames: int) -> Tensor:
    """Features (T, ...) of a whole clip, with its first frame put before them some times."""
    return torch.cat([features[:1].expand(frames, *features.shape[1:]), features])
