"""How the body moves, as networks are told of it: without where it is and which way it faces.

A garment hangs alike wherever its body stands, so what goes in is the same for a clip that is turned about the vertical
or moved: the joints' rotations, which way is up, and how fast the root moves and turns, in the root's own axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.common.rates import between, sample_times
from imgtransfer.deformers.common.rotations import six_numbers
from render import InputError

ROOT_FEATURES, JOINT_FEATURES = 9, 6
_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of a body's root and joints.

    Args:
        root: (T, 3, 3) float64 rotations from the rest pose to the world.
        place: (T, 3) float64, the middle of the body if only its root moved, world metres.
        joints: (T, J - 1, 3) axis-angle of all joints but the root against their parents, radians.
        fps: frames a second.
    """

    root: np.ndarray
    place: np.ndarray
    joints: np.ndarray
    fps: float

    def __len__(self) -> int:
        return len(self.root)

    def at(self, fps: float) -> BodyMotion:
        """The same at another rate: rotations spherically, the path linearly; see `rates.sample_times`."""
        times = sample_times(len(self), self.fps, fps)
        before, part = between(times * self.fps, len(self))
        after = np.minimum(before + 1, len(self) - 1)
        joints = Rotation.from_rotvec(self.joints.reshape(-1, 3).astype(np.float64)).as_matrix()
        joints = joints.reshape(*self.joints.shape, 3)
        turned = _slerp(joints[before], joints[after], part[:, None])
        return BodyMotion(
            _slerp(self.root[before], self.root[after], part),
            self.place[before] + part[:, None] * (self.place[after] - self.place[before]),
            Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec().reshape(*turned.shape[:-1]),
            fps,
        )


def body_motion(clip: Clip, frames: RootFrames) -> BodyMotion:
    """The motion of a clip's body.

    Args:
        frames: of the clip, with the whole rotation of the root.

    Raises:
        InputError: a clip without poses.
    """
    poses = clip.skeleton.poses
    if poses is None:
        raise InputError(
            f"{clip.name}: has no poses (T, J, 3), and this method reads the body's motion from its joints; "
            "give a clip with a skeleton, or take a method that reads the body's surface (image_transfer)"
        )
    middle = clip.body.rest.astype(np.float64).mean(axis=0)
    place = frames.rotation @ middle + frames.translation
    return BodyMotion(frames.rotation, place, poses[:, 1:].astype(np.float64), clip.fps)


def root_features(motion: BodyMotion) -> np.ndarray:
    """(T, 9) float32 in the root's axes: the vertical, the velocity in m/s, the angular velocity in rad/s.

    Velocities are those since the frame before; the first frame has the second's, and a single frame none.
    """
    own = motion.root.swapaxes(1, 2)
    velocity, turning = np.zeros((2, len(motion), 3))
    if len(motion) > 1:
        velocity[1:] = motion.fps * np.diff(motion.place, axis=0)
        turning[1:] = motion.fps * Rotation.from_matrix(own[:-1] @ motion.root[1:]).as_rotvec()
        velocity[0], turning[0] = velocity[1], turning[1]
        velocity[0] = motion.root[0] @ own[1] @ velocity[1]
    features = np.concatenate([own @ _UP, (own @ velocity[..., None])[..., 0], turning], axis=1)
    return features.astype(np.float32)


def joint_features(motion: BodyMotion) -> np.ndarray:
    """(T, J - 1, 6) float32, see `rotations.six_numbers`."""
    return six_numbers(motion.joints)


def _slerp(start: np.ndarray, end: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(..., 3, 3) turned by a part (...) of the way from start to end."""
    way = Rotation.from_matrix((start.swapaxes(-1, -2) @ end).reshape(-1, 3, 3)).as_rotvec()
    scaled = way.reshape(*start.shape[:-1]) * part[..., None]
    return start @ Rotation.from_rotvec(scaled.reshape(-1, 3)).as_matrix().reshape(start.shape)
