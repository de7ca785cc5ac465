"""A training run from start to end: logged, validated, stopped and resumed."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from imgtransfer.config.loader import to_yaml
from imgtransfer.running.stopping import stop_between_steps
from imgtransfer.training.checkpoint import MODEL_FILE
from imgtransfer.training.config import RunConfig
from imgtransfer.training.log import LOG_FILE, log_from
from imgtransfer.training.needs import say_needs
from imgtransfer.training.prepared import remove_prepared
from imgtransfer.training.remaining import Remaining, say_remaining
from imgtransfer.training.run_folder import CONFIG_FILE, check_steps, only_trainer, state_to_resume
from imgtransfer.training.trainer import Trainer
from render import InputError, Option
from render.files.atomic import written_whole
from render.threads import one_blas_thread

_log = logging.getLogger(__name__)

SAVE_SECONDS = 600.0  # between checkpoints at most: a slow machine reaches its first only after long


@one_blas_thread()
def train(
    config: RunConfig, out: Path, *, resume: bool = False, tell: Callable[[float], None] = say_remaining
) -> Path:
    """Train to the end and write the results.

    Args:
        config: the run.
        out: folder for config.yaml, log.jsonl (a line a step and a validation; the first line that a process writes
            also says which number type it chose, and which model the run began with), model.safetensors,
            state.safetensors. Only one process may train there at a time.
        resume: go on with the run in `out`; one that has saved nothing yet begins at step 0.
        tell: called once with the seconds that are left, after the first steps.

    Returns:
        The model's file.

    Raises:
        InputError: bad data or configuration; a run in `out` already, or none to resume, or one of another
            configuration; another process that trains there.
        OSError: a file cannot be written; the error names it.
        KeyboardInterrupt: after Ctrl-C or SIGTERM (`Terminated`), once the state is saved.
    """
    if resume and not out.is_dir():
        raise InputError(f"{out}: no run to resume there; leave out {Option('resume')} to start one")
    with only_trainer(out):
        resumed = state_to_resume(out, config, resume=resume)
        trainer = Trainer(config)
        if resumed:
            trainer.load(out)
            check_steps(out, config, trainer.step)
        else:
            trainer.fit_head()
        with written_whole(out / CONFIG_FILE) as temporary:
            temporary.write_text(to_yaml(config))
        _log.info("%s", trainer.precision)
        trainer.prepare(out)
        trainer.cache_trunks(out)
        say_needs(config, config.training.steps - trainer.step, trainer.rehearse)
        _steps(trainer, out, tell)
        remove_prepared(out)
    return out / MODEL_FILE


def _steps(trainer: Trainer, out: Path, tell: Callable[[float], None]) -> None:
    """The steps that are left, with a bar."""
    options, started = trainer.config.training, time.monotonic()
    saved_step, saved_at = -1, started
    once = iter([trainer.precision.log_entry() | _begun_with(trainer)])  # with the first line of this process
    bar = tqdm(total=options.steps, initial=trainer.step, desc="train", unit="step", file=sys.stderr)
    with bar, log_from(out / LOG_FILE, trainer.step) as write, stop_between_steps() as stop:
        if trainer.step == 0:
            write({"step": 0, "seconds": 0.0, **trainer.validate(), **next(once)})
        remaining = Remaining(options.steps - trainer.step, tell)
        while trainer.step < options.steps and not stop:
            entry: dict[str, Any] = trainer.train_step()
            remaining.step()
            last = trainer.step == options.steps
            if last or trainer.step % options.validate_every_steps == 0:
                measured = trainer.validate()
                entry |= measured
                shown = {k: f"{v:.1f}" for k, v in measured.items() if not k.startswith("guess")}
                bar.set_postfix(shown, refresh=False)
            write(
                {
                    "step": trainer.step,
                    "seconds": round(time.monotonic() - started, 2),
                    **entry,
                    **next(once, {}),
                }
            )
            bar.update()
            late = time.monotonic() - saved_at > SAVE_SECONDS
            if late or trainer.step % options.checkpoint_every_steps == 0:
                trainer.save(out)
                saved_step, saved_at = trainer.step, time.monotonic()
        if saved_step != trainer.step:  # the end, or a stop, perhaps before the first step
            trainer.save(out)
    if trainer.step < options.steps:
        _log.info(
            "stopped after step %d; the same command with %s goes on", trainer.step, Option("resume", True)
        )
        raise stop.error()


def _begun_with(trainer: Trainer) -> dict[str, str | float]:
    """What the log says of the model that the run began with."""
    if trainer.init_mark is None:
        return {}
    return {"init": str(trainer.config.training.init), "init_sha256": trainer.init_mark}
