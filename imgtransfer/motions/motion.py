"""A motion: joint rotations and a path, at a frame rate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from imgtransfer.bodies.smpl import JOINTS, global_rotations, local_poses, segment_direction
from render import InputError
from render.limits import ANGLES, check_rate
from render.mesh.mesh import check_finite

MOST_FRAMES = 200_000  # that a motion is resampled to; nearly two hours


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of the 22 SMPL body joints over time; y up, at first facing +z.

    Args:
        poses: (T, 22, 3) float64 local axis-angle, radians; joint 0 is the global orientation.
        trans: (T, 3) float64 world position of the pelvis joint, metres, in the performer's own size.
        fps: frames a second.
        name: what logs and data sets call it.
        leg_length: hip to ankle of the performer, metres, by which `trans` is scaled to a body; None leaves it.
    """

    poses: np.ndarray
    trans: np.ndarray
    fps: float
    name: str
    leg_length: float | None = None

    def __post_init__(self) -> None:
        if self.poses.ndim != 3 or self.poses.shape[1:] != (len(JOINTS), 3) or len(self.poses) < 2:
            raise InputError(
                f"{self.name}: poses must be (T, 22, 3) with T of 2 or more, found {self.poses.shape}"
            )
        if self.trans.shape != (len(self.poses), 3):
            raise InputError(
                f"{self.name}: trans must have shape {(len(self.poses), 3)}, found {self.trans.shape}"
            )
        check_finite(self.poses, f"{self.name}: poses", limit=ANGLES, unit="rad")
        check_finite(self.trans, f"{self.name}: trans")
        check_rate(self.fps, self.name)

    @property
    def seconds(self) -> float:
        """From the first frame to the last, seconds."""
        return (len(self.poses) - 1) / self.fps


@contextmanager
def of_file(path: Path) -> Iterator[None]:
    """Let messages about the motion of a file, which is called by its stem, name the file."""
    try:
        yield
    except InputError as error:
        said = str(error).removeprefix(f"{path.stem}: ")
        raise InputError(said if said.startswith(f"{path}: ") else f"{path}: {said}") from error


def resample(motion: Motion, fps: float) -> Motion:
    """The motion at another frame rate: by time, rotations spherically, the path linearly; the first frame stays.

    Raises:
        InputError: one of hours, which would have more frames than anybody means, or one that would have a single
            frame.
    """
    if motion.fps == fps:
        return motion
    if motion.seconds * fps > MOST_FRAMES:
        raise InputError(
            f"{motion.name}: {len(motion.poses)} frames at {motion.fps:g} a second are {motion.seconds:.3g} s long, "
            f"more than {MOST_FRAMES} frames at {fps:g}; is the frame rate right?"
        )
    if motion.seconds * fps + 1e-6 < 1:
        raise InputError(
            f"{motion.name}: {len(motion.poses)} frames at {motion.fps:g} a second are {motion.seconds:.3g} s long, "
            f"less than one frame at {fps:g}; a longer motion or an `fps` of {math.ceil(motion.fps)} is wanted"
        )
    # Half a millionth of a frame of tolerance keeps a last frame that only rounding would drop.
    times = np.arange(int(motion.seconds * fps + 1e-6) + 1) / fps
    given = np.arange(len(motion.poses)) / motion.fps
    times = np.minimum(times, given[-1])
    poses = np.stack(
        [
            Slerp(given, Rotation.from_rotvec(motion.poses[:, j]))(times).as_rotvec()
            for j in range(len(JOINTS))
        ],
        axis=1,
    )
    trans = np.stack([np.interp(times, given, motion.trans[:, axis]) for axis in range(3)], axis=1)
    return Motion(poses, trans, fps, motion.name, motion.leg_length)


def arms_out(motion: Motion, degrees: float) -> Motion:
    """Turn each whole arm away from the trunk, so that cloth has room between them.

    The arm turns about the chest's forward axis by `degrees` where it hangs, fading to nothing as it is raised:
    performers have wider shoulders than the body, and their hanging arms would sink into it.
    """
    if degrees == 0:
        return motion
    rotations = global_rotations(motion.poses)
    chest = rotations[:, JOINTS.index("spine3")]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = [JOINTS.index(f"{side}_{joint}") for joint in ("shoulder", "elbow", "wrist")]
        direction = rotations[:, arm[0]] @ segment_direction("upper_arm", side)
        hanging = -(direction * chest[:, :, 1]).sum(axis=1)  # cosine to the chest's downward axis
        fraction = np.clip((hanging - 0.2) / 0.5, 0, 1)
        fraction = fraction * fraction * (3 - 2 * fraction)
        turn = Rotation.from_rotvec(
            np.radians(degrees) * sign * fraction[:, None] * chest[:, :, 2]
        ).as_matrix()
        for joint in arm:
            rotations[:, joint] = turn @ rotations[:, joint]
    return Motion(local_poses(rotations), motion.trans, motion.fps, motion.name, motion.leg_length)
