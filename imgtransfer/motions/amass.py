"""Reader of AMASS-style npz motion files, y or z up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.motion import Motion, of_file, resample
from imgtransfer.motions.summary import MotionSummary
from imgtransfer.motions.up_axis import CLEAR, UpAxis, unclear
from render import InputError
from render.files.npz import Npz, open_npz

BODY_COLUMNS = 3 * len(JOINTS)
_SHORTEST, _LONGEST = 0.01, 100.0  # metres of a leg; dolls and giants included
# Whose first 22 joints are these; MoSh also fits hands, faces and animals.
_BODIES = ("smpl", "smplh", "smplx")
_WANTED = ("poses", "trans", "mocap_framerate", "mocap_frame_rate", "leg_length")
_PARTS = ("root_orient", "pose_body")  # of `poses`, which some releases hold alone


def read_amass(
    path: str | Path, *, fps: float = 30.0, up_axis: UpAxis = "auto"
) -> tuple[Motion, MotionSummary]:
    """Read a motion and resample it; and what was taken from the file.

    The file holds `poses` (T, 66 or more; columns after the 22 body joints, such as hands, are left out; or
    `root_orient` and `pose_body` in its place), `trans` (T, 3), `mocap_framerate` (or `mocap_frame_rate`), and
    optionally `leg_length`. Original AMASS files have z up; they are turned by −90° about x.

    Args:
        up_axis: of the file; "auto" is the axis along which the trunk stands on average.

    Raises:
        InputError: no such file, not an npz of plain arrays, a missing array, one of a wrong shape, or a motion that
            does not show which way is up.
    """
    path = Path(path)
    with open_npz(path, "an AMASS-style npz with poses, trans and mocap_framerate") as npz:
        _check_model(npz, path)
        arrays = {key: npz.read(key) for key in _WANTED if key in npz}
        if "poses" not in arrays and all(key in npz for key in _PARTS):
            arrays["poses"] = _joined([npz.read(key) for key in _PARTS], path)
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
        z_up = up_axis == "z" or (up_axis == "auto" and _stands_along_z(motion, path))
        summary = MotionSummary(path, len(poses), motion.fps, "z" if z_up else "y", 1.0)
        return resample(_turned_up(motion) if z_up else motion, fps), summary


def holds_motion(path: Path) -> bool:
    """Whether an npz holds poses, good or bad; a subject's shape.npz and fits of a model hold none.

    Raises:
        InputError: not a readable npz.
    """
    with open_npz(path, "an AMASS-style npz with poses, trans and mocap_framerate") as npz:
        return "poses" in npz or all(key in npz for key in _PARTS)


def _check_model(npz: Npz, path: Path) -> None:
    """Raise InputError for poses of a hand, a face or an animal, where the file names its model."""
    key = "surface_model_type"
    if key not in npz or npz.dtype(key).kind not in "US" or npz.shape(key) != ():
        return
    named = npz.read(key).item()
    model = named.decode("latin-1") if isinstance(named, bytes) else str(named)
    if model.lower() not in _BODIES:
        raise InputError(f"{path}: {key} is '{model}'; motions of {', '.join(_BODIES)} are wanted")


def _joined(parts: list[np.ndarray], path: Path) -> np.ndarray:
    """(T, 66) of `root_orient` (T, 3) and `pose_body` (T, 63)."""
    root, body = parts
    if root.ndim != 2 or body.ndim != 2 or len(root) != len(body) or root.shape[1] != 3:
        raise InputError(
            f"{path}: root_orient and pose_body must have shapes (T, 3) and (T, 63), found {root.shape} and "
            f"{body.shape}"
        )
    return np.concatenate(parts, axis=1)


def _stands_along_z(motion: Motion, path: Path) -> bool:
    """Whether the pelvis' upward axis points along z rather than y, on average."""
    up = Rotation.from_rotvec(motion.poses[:, 0]).apply([0.0, 1.0, 0.0]).mean(axis=0)
    if max(up[1], up[2]) < CLEAR:
        raise unclear(path)
    return bool(up[2] > up[1])


def _turned_up(motion: Motion) -> Motion:
    """From z up to y up."""
    turn = Rotation.from_euler("x", -90, degrees=True)
    poses = motion.poses.copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    return replace(motion, poses=poses, trans=turn.apply(motion.trans))
