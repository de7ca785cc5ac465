"""The project's own motions: parametric joint-angle curves, so that a bare clone can make training data."""

from __future__ import annotations

import zlib

import numpy as np
from scipy.ndimage import gaussian_filter1d

from imgtransfer.bodies.smpl import HIP_MIDDLE, INDEX, global_rotations, segment_direction
from imgtransfer.motions.kinds import KINDS, Clock
from imgtransfer.motions.limits import NEUTRAL, SIDES, poses_from_angles, within_limits
from imgtransfer.motions.motion import Motion
from render import InputError

THIGH, SHIN, ANKLE_HEIGHT = 0.40, 0.40, 0.06  # metres
BLEND_IN = 0.6  # seconds from standing into the motion
FASTEST_FALL = 0.8 * 9.81  # m/s²; a body that fell faster than its clothes would leave them behind
STEP_LENGTH = 0.9  # fraction of the legs' swing that walking turns into distance


def make_motion(
    kind: str, *, seed: int = 0, tempo: float = 1.0, seconds: float = 2.5, fps: float = 30.0
) -> Motion:
    """A motion of the library.

    Args:
        kind: a key of `imgtransfer.motions.kinds.KINDS`.
        seed: chooses amplitudes, phases and asymmetry; the same arguments always give the same motion.
        tempo: 1 is usual, 2 is twice as fast; 0.1 to 5.
        seconds: how long it lasts, 0.2 to 600.
        fps: frames a second, 5 to 1000.

    Raises:
        InputError: an unknown kind, or a tempo, duration or frame rate out of range.
    """
    if kind not in KINDS:
        raise InputError(f"motion {kind!r} is not in the library; there are {', '.join(KINDS)}")
    for name, value, low, high in (
        ("tempo", tempo, 0.1, 5),
        ("seconds", seconds, 0.2, 600),
        ("fps", fps, 5, 1000),
    ):
        if not low <= value <= high:
            raise InputError(f"motion {kind}: {name} is {value}; a number from {low} to {high} expected")
    frames = max(2, round(seconds * fps))
    time = np.arange(frames) / fps
    random = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    curves = KINDS[kind](Clock(time, fps, tempo, random))
    hop = np.maximum(np.broadcast_to(curves.pop("hop", 0.0), (frames,)), 0)
    speeds = [curves.pop(name, np.zeros(frames)) for name in ("sideways", "forward")]
    angles = within_limits(curves, frames)
    fraction = np.clip(time / BLEND_IN, 0, 1)
    fraction = fraction * fraction * (3 - 2 * fraction)
    angles = {name: NEUTRAL[name] + fraction * (values - NEUTRAL[name]) for name, values in angles.items()}
    poses = poses_from_angles(angles)
    trans = _path(poses, fraction * hop, fraction * speeds, fps, travels=kind in ("walk", "run", "mixed"))
    return Motion(poses, trans, fps, f"{kind}_s{seed}", THIGH + SHIN)


def _path(poses: np.ndarray, hop: np.ndarray, speeds: np.ndarray, fps: float, *, travels: bool) -> np.ndarray:
    """(T, 3) pelvis positions that keep the lower foot on the floor, plus `hop` (T,) metres, as gravity allows.

    Besides, they go on by `speeds` (see `_travelled`).
    """
    rotations = global_rotations(poses)
    pelvis = rotations[:, 0]
    feet = []
    for side in SIDES:
        thigh = rotations[:, INDEX[f"{side}_hip"]] @ segment_direction("thigh", side)
        shin = rotations[:, INDEX[f"{side}_knee"]] @ segment_direction("shin", side)
        feet.append(pelvis @ HIP_MIDDLE + THIGH * thigh + SHIN * shin)
    drop = np.stack(feet)[:, :, 1]
    trans = np.zeros((len(poses), 3))
    height = gaussian_filter1d(ANKLE_HEIGHT - drop.min(axis=0), 0.05 * fps, mode="nearest") + hop
    # Landings are rounded off, which at the ends of the motion may bend the path downwards again.
    rounded = gaussian_filter1d(falling_slower(height, fps), 0.03 * fps, mode="nearest")
    trans[:, 1] = falling_slower(rounded, fps)
    if travels:
        # What the standing foot moves back under the body, the body moves forward.
        forward = pelvis[:, :, 2] * [1.0, 0.0, 1.0]
        ahead = np.einsum("stk,tk->st", np.stack(feet), forward)
        back = -np.gradient(ahead, axis=1)
        standing = drop.argmin(axis=0)
        step = STEP_LENGTH * np.maximum(back[standing, np.arange(len(poses))], 0)
        step = gaussian_filter1d(step, 0.15 * fps, mode="nearest")
        trans += np.cumsum(step[:, None] * forward, axis=0)
    return trans + _travelled(pelvis, speeds, fps)


def _travelled(pelvis: np.ndarray, speeds: np.ndarray, fps: float) -> np.ndarray:
    """(T, 3) how far a pelvis, turned by (T, 3, 3), has come by speeds (2, T) to its left and ahead, m/s."""
    level = pelvis[:, :, [0, 2]] * np.array([1.0, 0.0, 1.0])[:, None]
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    return np.cumsum(np.einsum("tij,jt->ti", level, speeds) / fps, axis=0)


def falling_slower(height: np.ndarray, fps: float) -> np.ndarray:
    """The highest path under `height` (T,), metres, that nowhere accelerates downwards by more than `FASTEST_FALL`.

    With half of that times t² added, such a path is convex: it is the lower convex hull of what is given, without the
    same again.
    """
    time = np.arange(len(height)) / fps
    parabola = FASTEST_FALL / 2 * time**2
    lifted = height + parabola
    hull: list[int] = []
    for new in range(len(height)):
        while len(hull) > 1:
            before, last = hull[-2:]
            rise = (lifted[new] - lifted[before]) / (time[new] - time[before])
            if lifted[last] < lifted[before] + rise * (time[last] - time[before]):
                break
            hull.pop()
        hull.append(new)
    return np.interp(time, time[hull], lifted[hull]) - parabola
