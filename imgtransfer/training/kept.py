"""The files of a run beside its last state: earlier states with their models, and the model of the best validation."""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imgtransfer.training.checkpoint import MODEL_FILE, STATE_FILE
from render.files.atomic import written_whole_folder

BEST_FILE = "best.safetensors"
CHECKPOINTS_FOLDER = "checkpoints"
MEASURE = "position_mm"  # what a validation is judged by


@dataclass
class Best:
    """The best validation of a run so far.

    Args:
        error: its `MEASURE`; the one before the first step counts, too.
        step: after how many steps.
    """

    error: float = math.inf
    step: int = 0

    def take(self, measured: dict[str, float], step: int) -> None:
        """Take in the validation after `step` steps."""
        if measured[MEASURE] < self.error:
            self.error, self.step = measured[MEASURE], step

    def header(self) -> dict[str, Any]:
        """As a state's header has it."""
        return {"error": self.error if math.isfinite(self.error) else None, "step": self.step}

    @classmethod
    def of_header(cls, value: object) -> Best:
        """What `header` gave; a run of an earlier version has kept none."""
        known = value if isinstance(value, dict) else {}
        error, step = known.get("error"), known.get("step")
        if isinstance(error, float) and isinstance(step, int):
            return cls(error, step)
        return cls()


def keep_checkpoint(run: Path, step: int, count: int) -> None:
    """Keep the state and the model that were saved in a run's folder at `step`, and delete all but the last `count`.

    They share their bytes with those of the run's folder until these are replaced, where the file system can do that.
    The last state is in the run's folder in any case, so that one alone needs no more.
    """
    folder = run / CHECKPOINTS_FOLDER
    if count > 1:
        with written_whole_folder(folder / f"{step:09d}") as temporary:
            for name in (STATE_FILE, MODEL_FILE):
                _link(run / name, temporary / name)
    for old in sorted(path for path in folder.glob("[0-9]*"))[: -count if count > 1 else None]:
        shutil.rmtree(old)


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without hard links
        shutil.copyfile(source, target)
