"""Reader of AMASS-style npz motion files, y or z up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.motion import Motion, of_file, resample
from render import InputError
from render.files.npz import open_npz

BODY_COLUMNS = 3 * len(JOINTS)


UpAxis = Literal["auto", "y", "z"]
_SHORTEST, _LONGEST = 0.01, 100.0  # metres of a leg; dolls and giants included
_CLEAR = 0.5  # cosine from which on a trunk is upright along an axis, on average over the frames


def load_amass(path: str | Path, *, fps: float = 30.0, up_axis: UpAxis = "auto") -> Motion:
    """Read a motion and resample it.

    The file holds `poses` (T, 66 or more; columns after the 22 body joints, such as hands, are left out), `trans`
    (T, 3), `mocap_framerate` (or `mocap_frame_rate`), and optionally `leg_length`. Original AMASS files have z up;
    they are turned by −90° about x.

    Args:
        up_axis: of the file; "auto" is the axis along which the trunk stands on average.

    Raises:
        InputError: no such file, not an npz of plain arrays, a missing array, one of a wrong shape, or a motion that
            does not show which way is up.
    """
    path = Path(path)
    wanted = ("poses", "trans", "mocap_framerate", "mocap_frame_rate", "leg_length")
    with open_npz(path, "an AMASS-style npz with poses, trans and mocap_framerate") as npz:
        arrays = {key: npz.read(key) for key in wanted if key in npz}
    if "mocap_frame_rate" in arrays:  # the spelling of SMPL-X releases
        arrays.setdefault("mocap_framerate", arrays.pop("mocap_frame_rate"))
    missing = [key for key in ("poses", "trans", "mocap_framerate") if key not in arrays]
    if missing:
        raise InputError(
            f"{path}: lacks {', '.join(missing)}; an AMASS-style npz has poses, trans, mocap_framerate"
        )
    poses, trans = arrays["poses"], arrays["trans"]
    for key, value in arrays.items():
        if value.dtype.kind not in "fiu":
            raise InputError(f"{path}: {key} must hold numbers, found {value.dtype}")
    if poses.ndim != 2 or poses.shape[1] < BODY_COLUMNS:
        raise InputError(f"{path}: poses must have shape (T, {BODY_COLUMNS} or more), found {poses.shape}")
    if arrays["mocap_framerate"].size != 1:
        raise InputError(f"{path}: mocap_framerate must be one number")
    leg = arrays.get("leg_length")
    if leg is not None and (leg.size != 1 or not _SHORTEST <= float(leg.reshape(())) <= _LONGEST):
        raise InputError(
            f"{path}: leg_length must be one number of metres from {_SHORTEST} to {_LONGEST:g}, found {leg}"
        )
    with of_file(path):
        motion = Motion(
            poses[:, :BODY_COLUMNS].astype(np.float64).reshape(len(poses), len(JOINTS), 3),
            trans.astype(np.float64),
            float(arrays["mocap_framerate"].reshape(())),
            path.stem,
            None if leg is None else float(leg.reshape(())),
        )
        if up_axis == "z" or (up_axis == "auto" and _stands_along_z(motion, path)):
            motion = _turned_up(motion)
        return resample(motion, fps)


def _stands_along_z(motion: Motion, path: Path) -> bool:
    """Whether the pelvis' upward axis points along z rather than y, on average."""
    up = Rotation.from_rotvec(motion.poses[:, 0]).apply([0.0, 1.0, 0.0]).mean(axis=0)
    if max(up[1], up[2]) < _CLEAR:
        raise InputError(
            f"{path}: the body lies or turns over, so the file does not show which axis is up; say so by up_axis y or z"
        )
    return bool(up[2] > up[1])


def _turned_up(motion: Motion) -> Motion:
    """From z up to y up."""
    turn = Rotation.from_euler("x", -90, degrees=True)
    poses = motion.poses.copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    return replace(motion, poses=poses, trans=turn.apply(motion.trans))
