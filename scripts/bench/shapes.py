"""Garments and bodies for the benches, made from formulas; metres, y up, facing +z."""

from __future__ import annotations

import numpy as np

from render import Mesh

SMALL, LARGE = (88, 50), (146, 83)  # 4,400 vertices and 8,624 faces; 12,118 and 23,944
SMPL_SIZED = (84, 82)  # 6,890 vertices and 13,776 faces, as many as the SMPL body has
HEIGHT, WIDTH, DEPTH = 0.65, 0.25, 0.14  # of the garment; width and depth are half axes of its ellipse
CLEARANCE = 0.012  # between garment and body at rest


def garment(around: int, along: int) -> Mesh:
    """An even tube of a T-shirt's size, open at both ends: around · along vertices, 2 · around · (along - 1) faces."""
    levels = np.linspace(-HEIGHT / 2, HEIGHT / 2, along)
    vertices = _rings(around, levels, np.ones(along), WIDTH, DEPTH)
    return Mesh(vertices, _sides(around, along), source=f"tube of {len(vertices)} vertices")


def body(around: int, along: int) -> Mesh:
    """A closed body that fills the garment up to `CLEARANCE` and ends above and below it.

    around · along + 2 vertices and 2 · around · along faces.
    """
    half = 0.75 * HEIGHT
    levels = np.linspace(-half, half, along + 2)[1:-1]
    profile = np.sqrt(1 - (levels / half) ** 12)
    rings = _rings(around, levels, profile, WIDTH - CLEARANCE, DEPTH - CLEARANCE)
    vertices = np.concatenate([rings, [[0, -half, 0], [0, half, 0]]])
    return Mesh(vertices, closed_sides(around, along), source=f"body of {len(vertices)} vertices")


def moved(points: np.ndarray, frames: int) -> np.ndarray:
    """(N, 3) -> (frames, N, 3) float32: twisted about y and bent sideways, more with every frame.

    The bend keeps lengths along the middle: x moves on circles about a centre at the side.
    """
    out = []
    for strength in np.linspace(0.3, 1.0, frames):
        turn, curvature = strength * 0.9 * points[:, 1], strength * 1.2
        x = points[:, 0] * np.cos(turn) + points[:, 2] * np.sin(turn)
        z = points[:, 2] * np.cos(turn) - points[:, 0] * np.sin(turn)
        angle, radius = curvature * points[:, 1], 1 / curvature - x
        out.append(np.stack([1 / curvature - radius * np.cos(angle), radius * np.sin(angle), z], axis=1))
    return np.stack(out).astype(np.float32)


def wrinkled(mesh: Mesh, frames: int) -> np.ndarray:
    """(frames, N, 3) float32: the garment moved as its body, with folds up to 1 cm towards it and 1 cm away.

    Bend and folds stretch it, which cloth does not do: good for timing, not for measuring accuracy.
    """
    x, y, z = mesh.vertices.T
    angle = np.arctan2(x / WIDTH, z / DEPTH)
    folds = 0.01 * np.sin(11 * angle + 9 * y)[:, None]
    outward = np.stack([x / WIDTH**2, np.zeros_like(x), z / DEPTH**2], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return moved(mesh.vertices + folds * outward, frames)


def closed_sides(around: int, along: int) -> np.ndarray:
    """(2 · around · along, 3) faces of a closed tube: rings from below, then the two ends' middles, the lower first."""
    n, here = around * along, np.arange(around)
    following, top = (here + 1) % around, n - around
    ends = [
        np.stack([np.full(around, n), following, here], axis=1),
        np.stack([np.full(around, n + 1), top + here, top + following], axis=1),
    ]
    return np.concatenate([_sides(around, along), *ends])


def _rings(
    around: int, levels: np.ndarray, scale: np.ndarray, width: float, depth: float
) -> np.ndarray:  # (rings · around, 3), bottom ring first
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    x, z = np.outer(scale, width * np.sin(angle)), np.outer(scale, depth * np.cos(angle))
    return np.stack([x, np.broadcast_to(levels[:, None], x.shape), z], axis=-1).reshape(-1, 3)


def _sides(around: int, along: int) -> np.ndarray:  # (2 · around · (along - 1), 3)
    row, column = (part.ravel() for part in np.mgrid[: along - 1, :around])
    a, b = row * around + column, row * around + (column + 1) % around
    return np.concatenate(
        [np.stack([a, b, b + around], axis=1), np.stack([a, b + around, a + around], axis=1)]
    )
