"""Places around a patch of cloth, at which the network is told where body and cloth are and how the body has moved."""

from __future__ import annotations

import numpy as np

# Shells around the patch: radius and width of the smoothing there, metres. Near the cloth in detail, farther off in
# outline; beyond half a metre nothing, so that a leg does not teach a sleeve. The best of
# six that were tried with one group of training clips left out.
_SHELLS_M = ((0.0, 0.05), (0.1, 0.04), (0.2, 0.06), (0.35, 0.06), (0.55, 0.1))


def _directions() -> tuple[np.ndarray, ...]:
    """Unit vectors for each shell: the centre; axes and corners of a cube (14, 3); those and its edges (26, 3)."""
    cube = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    length = np.linalg.norm(cube, axis=1)
    around = cube[length > 0] / length[length > 0][:, None]
    coarse = around[np.abs(length[length > 0] - 2**0.5) > 0.1]
    return np.zeros((1, 3)), coarse, around, around, around


def places() -> tuple[np.ndarray, np.ndarray]:
    """Offsets (K, 3) from a patch's centre at rest, and the width (K,) of the smoothing at each, metres, float64."""
    shells = _directions()
    offsets = np.concatenate([radius * shell for (radius, _), shell in zip(_SHELLS_M, shells, strict=True)])
    widths = np.concatenate(
        [np.full(len(shell), width) for (_, width), shell in zip(_SHELLS_M, shells, strict=True)]
    )
    return offsets, widths


def ring_of_place() -> np.ndarray:
    """(K,) int64: which shell each place is on, from the patch's centre outwards."""
    return np.repeat(np.arange(len(_SHELLS_M)), [len(shell) for shell in _directions()])


def mirrored_places() -> np.ndarray:
    """(K,) int64: which place is the mirror image of each in the plane x = 0."""
    offsets, _ = places()
    apart = np.abs(offsets[:, None] * [-1, 1, 1] - offsets[None]).sum(-1)
    return apart.argmin(1)


PLACES = len(places()[0])  # K
