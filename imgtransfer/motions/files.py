"""Motion files of every kind, by their suffix."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.motions.amass import UpAxis, load_amass
from imgtransfer.motions.bvh import load_bvh
from imgtransfer.motions.motion import Motion
from render import InputError

SUFFIXES = (".npz", ".bvh")


def load_motion(path: str | Path, *, fps: float = 30.0, up_axis: UpAxis = "auto") -> Motion:
    """Read an AMASS-style npz or a BVH file, at another frame rate.

    Args:
        path: a .npz or .bvh file.
        fps: of the result, frames a second; rotations are resampled spherically, the path linearly.
        up_axis: of an npz; the skeleton of a BVH file shows its own.

    Raises:
        InputError: another kind of file, or one that cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a motion file is wanted, {' or '.join(SUFFIXES)}")
    return load_bvh(path, fps=fps) if suffix == ".bvh" else load_amass(path, fps=fps, up_axis=up_axis)
