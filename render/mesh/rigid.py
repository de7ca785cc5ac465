"""Rotations of meshes: the rigid fit of one point set to another, and the parts of a rotation."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_UP = np.array([0.0, 1.0, 0.0])


def rigid_rotation(
    start: np.ndarray, end: np.ndarray, weights: np.ndarray | None = None
) -> NDArray[np.float64]:
    """The rotation that brings points nearest to others about the means of both (Kabsch 1976).

    Args:
        start, end: (N, 3) floating point, point by point the same.
        weights: (N,) what each pair counts, not negative, of sum 1; also in both means. None: 1 / N each.

    Returns:
        (3, 3) float64, of determinant 1 even where a mirror image would fit better. Where several rotations fit alike
        (points on a line, or all at one place) one of them; the identity for points that stay.
    """
    before, after = ((points - _mean(points, weights)).astype(np.float64) for points in (start, end))
    if weights is not None:
        after *= weights[:, None]
    covariance = after.T @ before
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Optimal rotation is not uniquely or poorly defined", UserWarning)
        # The fit knows the points by their covariance only, so three vectors stand for all of them.
        turn, _ = Rotation.align_vectors(covariance.T, np.eye(3))
    rotation: NDArray[np.float64] = turn.as_matrix()
    return rotation


def _mean(points: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    mean: np.ndarray = points.mean(axis=0) if weights is None else weights @ points
    return mean


def twist_angle(rotation: np.ndarray, axis: np.ndarray) -> NDArray[np.float64]:
    """How far rotations turn about an axis (swing-twist decomposition).

    Args:
        rotation: (3, 3) or (T, 3, 3).
        axis: (3,) of length 1.

    Returns:
        () or (T,) radians, from -2π to 2π; 0 for half turns about an axis that is orthogonal to this one, which have
        no twist.
    """
    quaternion: NDArray[np.float64] = Rotation.from_matrix(rotation).as_quat()  # x, y, z, w
    sine: NDArray[np.float64] = quaternion[..., :3] @ axis
    return 2 * np.arctan2(sine, quaternion[..., 3])


def heading(rotation: np.ndarray) -> NDArray[np.float64]:
    """The part of rotations that turns about +y, the vertical.

    It stays defined when the body lies or bends until it faces the floor; only a root that hangs exactly
    upside down has no heading, and then the identity is returned.

    Args:
        rotation: (3, 3) or (T, 3, 3).

    Returns:
        Like `rotation`, float64.
    """
    turns: NDArray[np.float64] = Rotation.from_rotvec(twist_angle(rotation, _UP)[..., None] * _UP).as_matrix()
    return turns
