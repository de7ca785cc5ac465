"""Small helpers on stacks of rotation matrices (T, 3, 3)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from render.mesh.rigid import twist_angle


def between(start: np.ndarray, end: np.ndarray, fraction: float | np.ndarray) -> np.ndarray:
    """Spherical interpolation from `start` to `end`, (..., 3, 3) each; `fraction` in [0, 1], a number or (...)."""
    first = Rotation.from_matrix(start.reshape(-1, 3, 3))
    step = (first.inv() * Rotation.from_matrix(end.reshape(-1, 3, 3))).as_rotvec()
    fraction = np.broadcast_to(fraction, start.shape[:-2]).reshape(-1, 1)
    return (first * Rotation.from_rotvec(fraction * step)).as_matrix().reshape(start.shape)


def about(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(3,) unit axis, (T,) radians -> (T, 3, 3)."""
    return Rotation.from_rotvec(np.asarray(angles)[:, None] * axis).as_matrix()


def twist(rotations: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(T,) radians, continuous in time: how far (T, 3, 3) turn about the unit `axis` (swing-twist decomposition).

    Unwrapped over the frames, because callers halve the angle and half of a wrapped one is off by 180 degrees.
    """
    return np.unwrap((twist_angle(rotations, axis) + np.pi) % (2 * np.pi) - np.pi)


def segment_frame(direction: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """(3, 3) right-handed frame with the columns direction, hinge (made orthogonal to it) and their cross product."""
    first = direction / np.linalg.norm(direction)
    second = hinge - (hinge @ first) * first
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)
