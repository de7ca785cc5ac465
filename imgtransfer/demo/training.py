"""The demo's training: as long as the user has time for, gone on with where it was stopped."""

from __future__ import annotations

import json
import logging
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from imgtransfer.config.loader import load_config
from imgtransfer.training.checkpoint import STATE_FILE, STATE_FORMAT, read_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.remaining import duration, say_remaining
from imgtransfer.training.run_folder import CONFIG_FILE, may_go_on, only_trainer
from imgtransfer.training.trainer import Trainer
from render import InputError, Option
from render.files.atomic import written_whole

_log = logging.getLogger(__name__)

LONG_MINUTES = 15.0  # from here on a shorter training is offered
_WARM_UP, _TIMED = 2, 4  # steps
_RESERVE = 0.8  # fraction of the time for steps; the rest is for validations


@dataclass(frozen=True)
class Length:
    """How long to train; by default as long as the configuration says.

    Args:
        steps: so many. minutes: as many as fit into this time on this machine.
    """

    steps: int | None = None
    minutes: float | None = None

    def __post_init__(self) -> None:
        if self.steps is not None and self.minutes is not None:
            raise InputError(f"{Option('steps')} and {Option('minutes')} say the same; give one of them")
        if self.steps is not None and self.steps < 1:
            raise InputError(f"{Option('steps')} {self.steps}: a whole number from 1 on is wanted")
        if self.minutes is not None and not 0 < self.minutes < 1e6:
            raise InputError(f"{Option('minutes')} {self.minutes}: a number of minutes above 0 is wanted")


def trained(out: Path, config: RunConfig, length: Length) -> Path:
    """The model of a run in `out`/run: new, gone on with, or finished before.

    A run there of other settings, or of more steps than are asked for, is replaced.

    Args:
        out: the demo's folder. config: of the training. length: in place of the configuration's steps.

    Returns:
        The model's file.

    Raises:
        InputError: another process trains there, or a damaged run.
    """
    folder = out / "run"
    config = _with_length(out, config, length)
    if folder.exists() and not _goes_on(folder, config):
        _log.info("The run in %s had other settings; starting a new one", folder)
        with only_trainer(folder):
            shutil.rmtree(folder)
    return train(config, folder, resume=folder.exists(), tell=_tell)


def _goes_on(folder: Path, config: RunConfig) -> bool:
    if not (folder / CONFIG_FILE).exists():
        return False
    state = folder / STATE_FILE
    done = int(read_tensors(state, STATE_FORMAT)[1]["step"]) if state.exists() else 0
    return may_go_on(load_config(RunConfig, folder / CONFIG_FILE), config) and done <= config.training.steps


def _tell(seconds: float) -> None:
    say_remaining(seconds)
    if seconds > 60 * LONG_MINUTES:
        _log.info("for a shorter one: Ctrl-C, then   scripts/demo --minutes 10")


def _with_length(out: Path, config: RunConfig, length: Length) -> RunConfig:
    steps = length.steps
    if length.minutes is not None:
        steps = _steps_in(out, config, length.minutes)
    if steps is None:
        return config
    warm_up = min(config.training.warmup_steps, steps // 4)
    training = config.training.model_copy(update={"steps": steps, "warmup_steps": warm_up})
    return config.model_copy(update={"training": training})


def _steps_in(out: Path, config: RunConfig, minutes: float) -> int:
    """How many steps this machine does in that time; kept, so that a run that was stopped goes on as it began."""
    path = out / "length.json"
    try:
        known = json.loads(path.read_text())
        if known["minutes"] == minutes:
            return max(1, int(known["steps"]))
    except (OSError, ValueError, KeyError, TypeError):
        pass  # not asked before
    trainer = Trainer(config)
    for _ in range(_WARM_UP):
        trainer.train_step()
    started = time.perf_counter()
    for _ in range(_TIMED):
        trainer.train_step()
    seconds = (time.perf_counter() - started) / _TIMED
    steps = max(1, int(60 * minutes * _RESERVE / seconds))
    _log.info("%d steps of %.2f s fit into %s", steps, seconds, duration(60 * minutes))
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps({"minutes": minutes, "steps": steps}) + "\n")
    return steps
