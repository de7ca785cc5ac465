"""What can be wrong with the files of bodies and garments, found before any work is done."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from tqdm import tqdm

from imgtransfer.bodies.config import SmplConfig, make_body
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.garments.garment import resting, template_garment
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.motion import check_motion
from imgtransfer.simulation.body_motion.body_sequence import BodySequence, speed_fault
from imgtransfer.simulation.planning.task import Task
from render import InputError

_log = logging.getLogger(__name__)


def check_files(tasks: Sequence[Task]) -> None:
    """Read the files of bodies and garments, and check each garment's mesh on each body that wears it, once.

    Raises:
        InputError: files that cannot be read, or a garment that does not fit its body.
    """
    checked: set[object] = set()
    said: set[str] = set()

    def note(text: str) -> None:
        if text not in said:
            _log.warning("note: %s", text)
        said.add(text)

    for task in tasks:
        motion, garment = task.motion, task.config.garment
        own = garment if isinstance(garment, TemplateConfig) else None
        wears = (motion.rest or motion.moving) if isinstance(motion, BodySequence) else task.config.body
        if (wears, own) in checked:
            continue
        checked.add((wears, own))
        if isinstance(motion, BodySequence):
            opened = motion.open()
            wearer, axes, called = opened.sequence.mesh, opened.axes, ""
            if motion.rest is None:
                note(f"{motion.moving}: no body_rest beside it, so its first frame is taken as the rest pose")
        elif own is not None or isinstance(task.config.body, SmplConfig):
            wearer, axes = resting(make_body(task.config.body)), None
            called = task.config.body.title
        else:
            continue
        if own is None:
            continue
        try:
            for text in template_garment(wearer, own, body_axes=axes)[1]:
                note(text)
        except InputError as error:
            raise InputError(f"on the body {called}: {error}" if called else str(error)) from error
        if isinstance(motion, BodySequence):
            for text in refuse(check_motion([motion.open()]), anyway=own.anyway):
                note(text)


def steady(tasks: Sequence[Task]) -> list[Task]:
    """The tasks without those on mesh sequences that jump, which are named in the log; reads the sequences' frames.

    Raises:
        InputError: frames that cannot be read or do not fit together.
    """
    faults: dict[BodySequence, str | None] = {}
    sequences = dict.fromkeys(task.motion for task in tasks if isinstance(task.motion, BodySequence))
    for sequence in tqdm(sequences, desc="check", unit="sequence", leave=False, disable=None):
        faults[sequence] = fault = speed_fault(sequence, sequence.read())
        if fault is not None:
            _log.warning("left out %s: %s", sequence.moving, fault)
    return [
        task for task in tasks if not isinstance(task.motion, BodySequence) or faults[task.motion] is None
    ]
