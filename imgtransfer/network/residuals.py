"""A first guess and what the networks add to it, as images."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from imgtransfer.network.base import Guess
from imgtransfer.network.maps import ImagePair
from render import PositionBox, encode_normals

# A decoder output of 1 in residual mode: about the size of the residuals, so that the networks deal with
# numbers near 1. Positions in metres, normals as parts of a unit vector.
POSITION_RESIDUAL_M = 0.05
NORMAL_RESIDUAL = 0.5


def corrected_images(guess: Guess, residuals: tuple[Tensor, Tensor], box: PositionBox) -> ImagePair:
    """Encoded images of a first guess with residuals (B, S, H, W, 3) in its axes, of positions and of normals.

    Normals are not yet of unit length.
    """
    return ImagePair(_positions(guess, residuals[0], box), encode_normals(_normals(guess, residuals[1])))


def averaged_images(
    guess: Guess, residuals: tuple[Tensor, Tensor], others: tuple[Tensor, Tensor], box: PositionBox
) -> ImagePair:
    """Encoded images: means of the positions, and of the unit normals, that two pairs of residuals give, made unit."""
    return ImagePair(
        _positions(guess, (residuals[0] + others[0]) / 2, box),
        encode_normals(mean_direction(_normals(guess, residuals[1]), _normals(guess, others[1]))),
    )


def mean_direction(first: Tensor, second: Tensor) -> Tensor:
    """(..., 3) vectors of any length -> the unit vectors between their directions."""
    units = [functional.normalize(vectors, dim=-1) for vectors in (first, second)]
    return functional.normalize(torch.add(*units), dim=-1)


def _positions(guess: Guess, residual: Tensor, box: PositionBox) -> Tensor:
    return box.encode(guess.positions + guess.turn(POSITION_RESIDUAL_M * residual))


def _normals(guess: Guess, residual: Tensor) -> Tensor:
    return guess.normals + guess.turn(NORMAL_RESIDUAL * residual)
