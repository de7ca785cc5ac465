"""Motions from files: what cannot be read or done by a body is left out and named, as long as others can."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from imgtransfer.motions.amass import holds_motion
from imgtransfer.motions.check import motion_faults
from imgtransfer.motions.files import read_motion
from imgtransfer.motions.motion import Motion
from imgtransfer.motions.summary import MotionSummary, summary_lines
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.sources import MotionFile
from render import InputError

_log = logging.getLogger(__name__)


def read_motions(files: Sequence[MotionFile], config: SimulateConfig) -> list[tuple[Motion, str]]:
    """Motions, called as the files' clips shall be, and the names of their files without suffix.

    An npz in a given folder that holds no poses, as a subject's shape.npz, is no motion file; all of them are noted
    in one line of the log. A file that cannot be read, or whose motion no body can do, is left out and named there.

    Raises:
        InputError: no file can be read; the message is that of the first.
    """
    passed: list[MotionFile] = []
    refused: list[tuple[MotionFile, InputError]] = []
    motions: list[tuple[Motion, str]] = []
    of_files = config.files
    summaries: list[MotionSummary] = []
    for file in files:
        try:
            if not file.listed and file.path.suffix.lower() == ".npz" and not holds_motion(file.path):
                passed.append(file)
                continue
            motion, summary = read_motion(
                file.path, fps=config.fps, up_axis=of_files.up_axis, joints=of_files.joints
            )
        except InputError as error:
            refused.append((file, error))
            continue
        summaries.append(summary)
        faults = motion_faults(motion, turning=of_files.turning, path_speed=of_files.path_speed)
        if faults:
            _log.warning("left out %s: %s", file.path, "; ".join(faults))
            continue
        motions.append((replace(motion, name=file.name), file.path.stem))
    _say(passed, refused, summaries)
    return motions


def _say(
    passed: Sequence[MotionFile],
    refused: Sequence[tuple[MotionFile, InputError]],
    summaries: Sequence[MotionSummary],
) -> None:
    """Say in the log what was read and how, and what was not.

    Raises:
        InputError: nothing was.
    """
    if refused and not summaries:
        raise refused[0][1]
    if passed and not summaries:
        raise InputError(
            f"{passed[0].path}: no poses in it, nor in any other file given; AMASS-style npz with poses, trans and "
            "mocap_framerate are wanted, or BVH"
        )
    for line in summary_lines(summaries):
        _log.info("motion summary: %s", line)
    if passed:
        some = ", ".join(str(file.path) for file in passed[:3]) + (", ..." if len(passed) > 3 else "")
        _log.warning("note: %d npz files without poses are passed over (%s)", len(passed), some)
    for _, error in refused:
        _log.warning("left out %s", error)
