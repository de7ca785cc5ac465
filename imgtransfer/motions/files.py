"""Motion files of every kind, by their suffix."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from imgtransfer.motions.amass import read_amass
from imgtransfer.motions.bvh import read_bvh
from imgtransfer.motions.motion import Motion
from imgtransfer.motions.summary import MotionSummary
from imgtransfer.motions.up_axis import UpAxis
from render import InputError

SUFFIXES = (".npz", ".bvh")


def load_motion(
    path: str | Path,
    *,
    fps: float = 30.0,
    up_axis: UpAxis = "auto",
    joints: Mapping[str, str] | None = None,
) -> Motion:
    """Read an AMASS-style npz or a BVH file, at another frame rate.

    Args:
        path: a .npz or .bvh file.
        fps: of the result, frames a second; rotations are resampled spherically, the path linearly.
        up_axis: of the file's world; "auto" is told by how the body stands.
        joints: a BVH skeleton's names of some of SMPL's joints, where its names do not tell.

    Raises:
        InputError: another kind of file, or one that cannot be read.
    """
    return read_motion(path, fps=fps, up_axis=up_axis, joints=joints)[0]


def read_motion(
    path: str | Path,
    *,
    fps: float = 30.0,
    up_axis: UpAxis = "auto",
    joints: Mapping[str, str] | None = None,
) -> tuple[Motion, MotionSummary]:
    """As `load_motion`, and what was taken from the file.

    Raises:
        InputError: another kind of file, or one that cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a motion file is wanted, {' or '.join(SUFFIXES)}")
    if suffix == ".bvh":
        return read_bvh(path, fps=fps, up_axis=up_axis, joints=joints)
    return read_amass(path, fps=fps, up_axis=up_axis)
