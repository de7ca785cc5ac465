"""What carries virtual bones: the body's root, or the part of the body's surface that is nearest to them at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from imgtransfer.deformers.common.bone_skinning import bones_about
from imgtransfer.deformers.common.rigid_bones import Bones, fit_cluster

_NEAREST = 100  # body vertices whose rigid motion a bone is carried by; so many that muscles and folds cancel


@dataclass(frozen=True, eq=False)
class Carried:
    """Rigid motions that bones are carried by, about where the bones rest, in the root's frame.

    Args:
        turn: (T, V, 3, 3) float32. offset: (T, V, 3) float32, metres.
    """

    turn: Tensor
    offset: Tensor

    @classmethod
    def nothing(cls, frames: int, bones: int) -> Carried:
        """By the root alone."""
        return cls(torch.eye(3).repeat(frames, bones, 1, 1), torch.zeros(frames, bones, 3))

    @classmethod
    def cat(cls, parts: Sequence[Carried]) -> Carried:
        """The frames of one after those of the other."""
        return cls(torch.cat([part.turn for part in parts]), torch.cat([part.offset for part in parts]))

    def of(self, frames: Tensor) -> Carried:
        """Those of frames (F,)."""
        return Carried(self.turn[frames], self.offset[frames])

    def put(self, turn: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
        """Bones that were carried, from what they do against it."""
        return self.turn @ turn, self.offset + (self.turn @ offset[..., None])[..., 0]

    def without(self, turn: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
        """The inverse of `put`."""
        back = self.turn.mT
        return back @ turn, (back @ (offset - self.offset)[..., None])[..., 0]


def carriers(rest: np.ndarray, posed: np.ndarray, places: np.ndarray) -> Carried:
    """The rigid fit to the body vertices nearest to each bone.

    Args:
        rest: (B, 3) of the body. posed: (T, B, 3) in the root's frame. places: (V, 3) where bones rest.
    """
    rest = rest.astype(np.float64)
    moves = posed.swapaxes(0, 1)
    _, near = cKDTree(rest).query(places, k=min(_NEAREST, len(rest)))
    fits = []
    for rows in near:
        chosen = np.sort(rows)
        some = np.ascontiguousarray(moves[chosen], np.float64)
        fits.append(fit_cluster(rest[chosen], some, np.ones(len(chosen), bool)))
    return Carried(*bones_about(Bones.stack(fits), places.astype(np.float64)))
