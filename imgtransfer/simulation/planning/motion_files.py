"""Motions from files: what cannot be read or done by a body is left out and named, as long as others can."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from imgtransfer.motions.amass import holds_motion
from imgtransfer.motions.check import motion_faults
from imgtransfer.motions.files import load_motion
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.sources import MotionFile
from render import InputError


def read_motions(files: Sequence[MotionFile], config: SimulateConfig) -> list[tuple[Motion, str]]:
    """Motions, called as the files' clips shall be, and the names of their files without suffix.

    An npz in a given folder that holds no poses, as a subject's shape.npz, is no motion file; all of them are noted
    in one line on stderr. A file that cannot be read, or whose motion no body can do, is left out and named there.

    Raises:
        InputError: no file can be read; the message is that of the first.
    """
    passed: list[MotionFile] = []
    refused: list[tuple[MotionFile, InputError]] = []
    motions: list[tuple[Motion, str]] = []
    of_files = config.files
    able = 0
    for file in files:
        try:
            if not file.listed and file.path.suffix.lower() == ".npz" and not holds_motion(file.path):
                passed.append(file)
                continue
            motion = load_motion(
                file.path, fps=config.fps, up_axis=of_files.up_axis, joints=of_files.joints, name=file.name
            )
        except InputError as error:
            refused.append((file, error))
            continue
        able += 1
        faults = motion_faults(motion, turning=of_files.turning, path_speed=of_files.path_speed)
        if faults:
            print(f"left out {file.path}: {'; '.join(faults)}", file=sys.stderr)
            continue
        motions.append((motion, file.path.stem))
    _say(passed, refused, able)
    return motions


def _say(passed: Sequence[MotionFile], refused: Sequence[tuple[MotionFile, InputError]], able: int) -> None:
    """Name what was not read.

    Raises:
        InputError: nothing was.
    """
    if refused and not able:
        raise refused[0][1]
    if passed and not able:
        raise InputError(
            f"{passed[0].path}: no poses in it, nor in any other file given; AMASS-style npz with poses, trans and "
            "mocap_framerate are wanted, or BVH"
        )
    if passed:
        some = ", ".join(str(file.path) for file in passed[:3]) + (", ..." if len(passed) > 3 else "")
        print(f"note: {len(passed)} npz files without poses are passed over ({some})", file=sys.stderr)
    for _, error in refused:
        print(f"left out {error}", file=sys.stderr)
