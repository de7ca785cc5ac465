"""Which vertices of a body belong to its arms, told by the joints."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from imgtransfer.bodies.smpl import INDEX

_SIDES = ("left", "right")
# Chains of joints with a typical radius of the limb, metres, by which a vertex is told to belong to an arm or not.
_TRUNK = (
    (("pelvis", "spine1", "spine2", "spine3", "neck", "head"), 0.11),
    *(((f"{side}_hip", f"{side}_knee", f"{side}_ankle", f"{side}_foot"), 0.06) for side in _SIDES),
    *((("pelvis", f"{side}_hip"), 0.11) for side in _SIDES),
    *((("spine3", f"{side}_collar", f"{side}_shoulder"), 0.06) for side in _SIDES),
)
ARM_RADIUS = 0.045


def on_arms(vertices: np.ndarray, joints: np.ndarray, arms: Sequence[np.ndarray]) -> np.ndarray:
    """(B,) bool, vertices (B, 3) that are nearer to an arm than to trunk, head or legs.

    Args:
        vertices: metres. joints: (22, 3), the SMPL joints. arms: chains (J, 3) from shoulder to fingertips.
    """
    rest = [
        along_chain(joints[[INDEX[name] for name in chain]], vertices)[2] - radius for chain, radius in _TRUNK
    ]
    to_arms = [along_chain(arm, vertices)[2] - ARM_RADIUS for arm in arms]
    return np.min(to_arms, axis=0) < np.min(rest, axis=0)


def along_chain(chain: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) seen from a chain (J, 3) of joints.

    Returns:
        (N,) distance along the chain to the nearest point on it, (N, 3) offset from there, (N,) distance.
    """
    start = 0.0
    best = (np.zeros(len(points)), np.zeros_like(points), np.full(len(points), np.inf))
    for first, last in pairwise(chain):
        length = float(np.linalg.norm(last - first))
        along = (last - first) / max(length, 1e-9)
        position = np.clip((points - first) @ along, 0, length)
        offset = points - first - position[:, None] * along
        distance = np.linalg.norm(offset, axis=1)
        nearer = distance < best[2]
        best = (
            np.where(nearer, start + position, best[0]),
            np.where(nearer[:, None], offset, best[1]),
            np.where(nearer, distance, best[2]),
        )
        start += length
    return best
