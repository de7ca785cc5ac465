"""Geometry as colours: positions and normals rescaled linearly to [0, 1] and back (RGB(·) of equation 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch

from render.errors import InputError
from render.limits import FARTHEST

_THINNEST = 1e-6  # metres; float32 divides by it without overflow

Values = TypeVar("Values", np.ndarray, torch.Tensor)


@dataclass(frozen=True, eq=False)
class PositionBox:
    """The axis-aligned box whose corners become colours 0 and 1. Positions outside it are not clipped.

    Args:
        lo, hi: (3,) float64, metres, lo < hi.

    Raises:
        InputError: other shapes, values that are not finite or beyond ±10 km, or a box thinner than a micrometre.
    """

    lo: np.ndarray
    hi: np.ndarray

    def __post_init__(self) -> None:
        lo, hi = np.asarray(self.lo, np.float64), np.asarray(self.hi, np.float64)
        fits = lo.shape == hi.shape == (3,) and (np.abs([lo, hi]) <= FARTHEST).all()
        if not fits or not (lo + _THINNEST <= hi).all():
            raise InputError(
                f"a position box needs three numbers lo < hi each, within ±{FARTHEST:g} m and {_THINNEST:g} m apart, "
                f"found lo {lo} and hi {hi}"
            )
        object.__setattr__(self, "lo", lo)
        object.__setattr__(self, "hi", hi)

    @classmethod
    def around(cls, points: np.ndarray, margin: float = 0.05) -> PositionBox:
        """The box of points (..., 3), widened at each side by `margin` of its extent (1 mm at least)."""
        points = np.asarray(points, np.float64).reshape(-1, 3)
        if len(points) == 0 or not np.isfinite(points).all():
            raise InputError(f"a position box needs finite points, found {len(points)} points")
        lo, hi = points.min(axis=0), points.max(axis=0)
        widening = np.maximum(margin * (hi - lo), 1e-3)
        return cls(lo - widening, hi + widening)

    def encode(self, positions: Values) -> Values:
        """Positions (..., 3) in metres to [0, 1] inside the box; dtype and device are kept."""
        encoded: Values = (positions - _like(self.lo, positions)) / _like(self.hi - self.lo, positions)
        return encoded

    def decode(self, colours: Values) -> Values:
        """The inverse of `encode`: (..., 3) to metres. Background pixels decode to `lo`: use the mask."""
        positions: Values = colours * _like(self.hi - self.lo, colours) + _like(self.lo, colours)
        return positions


def encode_normals(normals: Values) -> Values:
    """Unit vectors (..., 3) in [-1, 1] to colours (n + 1) / 2 in [0, 1]."""
    return (normals + 1) / 2


def decode_normals(colours: Values) -> Values:
    """Colours (..., 3) to vectors 2 c - 1, not scaled to unit length. Background becomes -1: use the mask."""
    return colours * 2 - 1


def _like(constant: np.ndarray, values: Values) -> Values:
    if isinstance(values, torch.Tensor):
        return torch.as_tensor(constant, dtype=values.dtype, device=values.device)
    kind = np.asarray(values).dtype
    return constant.astype(kind if np.issubdtype(kind, np.floating) else np.float64)
