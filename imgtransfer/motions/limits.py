"""Anatomical joint angles, how far each goes, and the joint rotations they stand for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import INDEX, JOINTS

# Degrees. Standing with hanging arms is 0 everywhere, but for `raise`, which keeps the arm clear of the trunk.
_TRUNK = {
    "yaw": (-1e4, 1e4),  # the whole body's heading, positive to its left
    "pitch": (-25.0, 60.0),  # the pelvis forward
    "roll": (-20.0, 20.0),  # the pelvis to its right
    "bend": (-25.0, 65.0),  # the spine forward
    "side": (-30.0, 30.0),  # the spine to its right
    "twist": (-45.0, 45.0),  # the spine to its left
    "nod": (-30.0, 40.0),
    "look": (-60.0, 60.0),
}
_LIMB = {
    "raise": (14.0, 155.0),  # the arm sideways, 0 hanging, 90 level
    "swing": (-50.0, 110.0),  # the arm forward
    "roll_in": (-50.0, 70.0),  # the upper arm about its own axis, palm forward to palm backward
    "elbow": (2.0, 135.0),
    "hip": (-30.0, 105.0),  # the thigh forward
    "spread": (-10.0, 45.0),  # the thigh sideways
    "turn_out": (-25.0, 40.0),
    "knee": (1.0, 130.0),
    "ankle": (-30.0, 25.0),  # the toes down
}
SIDES = ("left", "right")
LIMITS: dict[str, tuple[float, float]] = _TRUNK | {
    f"{side}_{name}": limits for side in SIDES for name, limits in _LIMB.items()
}
NEUTRAL = {name: min(max(0.0, low), high) for name, (low, high) in LIMITS.items()} | {
    f"{side}_{name}": value
    for side in SIDES
    for name, value in (("raise", 20.0), ("elbow", 14.0), ("knee", 4.0), ("hip", 2.0), ("spread", 3.0))
}


def within_limits(angles: Mapping[str, np.ndarray], frames: int) -> dict[str, np.ndarray]:
    """Every angle of `LIMITS` as (T,) degrees: those given, clipped, and the neutral value for the others."""
    return {
        name: np.broadcast_to(np.clip(angles.get(name, NEUTRAL[name]), low, high), (frames,)).astype(
            np.float64
        )
        for name, (low, high) in LIMITS.items()
    }


def poses_from_angles(angles: Mapping[str, np.ndarray]) -> np.ndarray:
    """(T,) degrees of every angle of `LIMITS` -> (T, 22, 3) local axis-angle of the SMPL joints, radians."""
    frames = len(angles["yaw"])
    poses = np.zeros((frames, len(JOINTS), 3))

    def put(joint: str, axes: str, *degrees: np.ndarray) -> None:
        turned = Rotation.from_euler(axes, np.stack(degrees, axis=1), degrees=True)
        poses[:, INDEX[joint]] = turned.as_rotvec()

    put("pelvis", "YXZ", angles["yaw"], angles["pitch"], angles["roll"])
    for joint, fraction in (("spine1", 0.4), ("spine2", 0.3), ("spine3", 0.3)):
        put(joint, "XZY", *(fraction * angles[name] for name in ("bend", "side", "twist")))
    for joint in ("neck", "head"):
        put(joint, "YX", angles["look"] / 2, angles["nod"] / 2)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        of = {name: angles[f"{side}_{name}"] for name in _LIMB}
        # The collar bone takes a part of what lies above 60 degrees, as a shoulder does.
        collar = 0.25 * np.clip(of["raise"] - 60, 0, None)
        put(f"{side}_collar", "Z", sign * collar)
        put(f"{side}_shoulder", "XZX", -of["swing"], sign * (of["raise"] - collar - 90), of["roll_in"])
        put(f"{side}_elbow", "Y", -sign * of["elbow"])
        put(f"{side}_hip", "XZY", -of["hip"], sign * of["spread"], sign * of["turn_out"])
        put(f"{side}_knee", "X", of["knee"])
        put(f"{side}_ankle", "X", of["ankle"])
    return poses
