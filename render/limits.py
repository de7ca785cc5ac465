"""What positions, rotations and frame rates can be: values beyond are damage, or of another unit, and are named."""

from __future__ import annotations

import numpy as np

from render.errors import InputError

FARTHEST = 1e4  # metres from the origin; float32 still tells millimetres apart there
FARTHEST_IN_FILES = 1e9  # from the origin, in whatever unit a mesh file has
SLOWEST, FASTEST = 0.01, 1e4  # frames a second
MAX_LENGTH = 8192  # pixels a side: every renderer can; software renderers crash on much larger images
MAX_LAYERS = 64  # surfaces along a ray; crumpled garments have ten
FARTHEST_OFF = 0.05  # metres off the skin at which cloth rests on it
ANGLES = 1e3  # radians of a joint's rotation
_RIGID = 1e-3  # by which R Rᵀ may differ from the identity


def check_rotations(rotations: np.ndarray, source: str) -> None:
    """Raise InputError, naming the first frame, unless all of (T, 3, 3) are rotations: R Rᵀ = 1 and det R = 1."""
    off = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero(~(off <= _RIGID))
    if len(bad):
        raise InputError(f"{source} must hold rotation matrices, R Rᵀ = 1; that of frame {bad[0]} is none")
    mirrors = np.flatnonzero(np.linalg.det(rotations) < 0)
    if len(mirrors):
        raise InputError(
            f"{source} must hold rotation matrices; that of frame {mirrors[0]} mirrors, its determinant is -1"
        )


def check_contact_offset(metres: float, source: str) -> None:
    """Raise InputError unless cloth can rest so far off the skin: 0 or more, and less than 5 cm."""
    if not 0 <= metres < FARTHEST_OFF:
        raise InputError(
            f"{source}: contact_offset_m is {metres}; metres at which cloth rests on skin expected, from 0 to below "
            f"{FARTHEST_OFF:g}"
        )


def check_rate(fps: float, source: str) -> None:
    """Raise InputError unless `fps` is a frame rate that can be: from 0.01 to 10,000 frames a second."""
    if not SLOWEST <= fps <= FASTEST:
        raise InputError(
            f"{source}: fps is {fps}; a positive number of frames a second expected, {SLOWEST:g} to {FASTEST:g}"
        )
