"""Which axis of a motion's world is up, by how its body stands."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from render import InputError, Option

UpAxis = Literal["auto", "y", "z"]
CLEAR = 0.5  # cosine from which on a trunk is upright along an axis, on average over the frames
# Heights of the pelvis over the world's origin, in legs: of somebody who stands, and of somebody who lies there.
_STANDING, _LYING = (0.5, 1.6), (0.05, 0.5)
_STILL = 0.3  # legs by which the height of somebody who lies changes at most; a walk is longer


def unclear(path: Path) -> InputError:
    """The refusal of a file that does not show which axis is up."""
    return InputError(
        f"{path}: the body lies or turns over, so the file does not show which axis is up; say so by "
        f"{Option('up_axis', 'y')} or {Option('up_axis', 'z')}"
    )


def up_of_world(
    trunk: np.ndarray, pelvis: np.ndarray, usual: np.ndarray, up_axis: UpAxis, path: Path, *, certain: bool
) -> np.ndarray:
    """(3,) the world's axis that is up, with its sign, in the file's axes.

    It is `usual`, unless the trunk clearly stands along another axis and the pelvis is as high along it as
    somebody's who stands.

    Args:
        trunk: (3,) mean over the frames of the unit vector up along the trunk.
        pelvis: (T, 3) positions of the pelvis, in lengths of a leg.
        usual: (3,) the axis that is up in such files.
        up_axis: what the user says; "auto" is nothing.
        path: of the file, for messages.
        certain: whether `usual` holds also for a body that lies or turns over: the skeleton shows it, not a habit.

    Raises:
        InputError: the body might as well stand along another axis as lie.
    """
    if up_axis != "auto":
        return np.eye(3)["xyz".index(up_axis)]
    axis = np.abs(trunk).argmax()
    along = np.sign(trunk[axis]) * np.eye(3)[axis]
    if abs(trunk[axis]) < CLEAR and not certain:
        raise unclear(path)
    if abs(trunk[axis]) < CLEAR or along @ usual > 0:
        return usual
    height, lying_height = pelvis @ along, pelvis @ usual
    standing = _STANDING[0] < height.mean() < _STANDING[1]
    lying = _LYING[0] <= lying_height.mean() < _LYING[1] and np.ptp(lying_height) < _STILL
    if standing == lying:
        raise unclear(path)
    return along if standing else usual


def axis_name(axis: np.ndarray) -> str:
    """ "y", "-z" and so on of a unit vector along an axis."""
    number = int(np.abs(axis).argmax())
    return f"{'-' if axis[number] < 0 else ''}{'xyz'[number]}"
