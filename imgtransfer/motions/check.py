"""What a body cannot do: motions that bend a joint too far, or move too fast."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.motion import Motion

# Degrees that a joint may turn from the T-pose, about whatever axis; the pelvis and the shoulders may turn anyhow.
_MOST = {
    "hip": 160.0,
    "knee": 170.0,
    "ankle": 100.0,
    "foot": 90.0,
    "spine1": 110.0,
    "spine2": 110.0,
    "spine3": 110.0,
    "neck": 100.0,
    "head": 100.0,
    "collar": 90.0,
    "elbow": 175.0,
    "wrist": 140.0,
}
TURNING = (
    2500.0  # degrees a second of a joint; pitchers' shoulders reach more, and no clothed motion here does
)
PATH_SPEED = 12.0  # m/s of the pelvis; sprinters reach it


def motion_faults(motion: Motion, *, turning: float = TURNING, path_speed: float = PATH_SPEED) -> list[str]:
    """What a body cannot do in a motion, one text a kind of fault; empty where there is nothing.

    Args:
        motion: at its own frame rate.
        turning: degrees a second that a joint may turn against its parent (the pelvis, in the world).
        path_speed: m/s of the pelvis, on a body with legs of 0.8 m.
    """
    count = len(motion.poses)
    turned = Rotation.from_rotvec(motion.poses.reshape(-1, 3))
    angle = np.degrees(turned.magnitude()).reshape(count, -1)
    most = np.array([_MOST.get(name.partition("_")[2] or name, 360.0) for name in JOINTS])
    quaternion = turned.as_quat().reshape(count, len(JOINTS), 4)
    half = np.abs((quaternion[1:] * quaternion[:-1]).sum(axis=-1)).clip(0, 1)
    speed = np.degrees(2 * np.arccos(half)) * motion.fps
    scale = 1.0 if motion.leg_length is None else 0.8 / motion.leg_length
    pelvis_speed = scale * np.linalg.norm(np.diff(motion.trans, axis=0), axis=1) * motion.fps
    faults = []
    if (angle > most).any():
        frame, joint = np.unravel_index((angle - most).argmax(), angle.shape)
        faults.append(
            f"{JOINTS[joint]} is turned by {angle[frame, joint]:.0f}° at {frame / motion.fps:.2f} s, where bodies "
            f"reach {most[joint]:.0f}°"
        )
    if (speed > turning).any():
        frame, joint = np.unravel_index(speed.argmax(), speed.shape)
        faults.append(
            f"{JOINTS[joint]} turns by {speed[frame, joint]:.0f}° a second at {frame / motion.fps:.2f} s, "
            f"at most {turning:.0f} are allowed"
        )
    if (pelvis_speed > path_speed).any():
        frame = int(pelvis_speed.argmax())
        faults.append(
            f"the body moves at {pelvis_speed[frame]:.1f} m/s at {frame / motion.fps:.2f} s, "
            f"at most {path_speed:g} are allowed"
        )
    return faults
