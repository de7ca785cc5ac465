"""A training run from start to end: logged, validated, stopped and resumed."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from tqdm import tqdm

from imgtransfer.config.loader import to_yaml
from imgtransfer.report.logs import read_entries
from imgtransfer.running.stopping import Stop, stop_between_steps
from imgtransfer.training.checkpoint import MODEL_FILE
from imgtransfer.training.config import RunConfig
from imgtransfer.training.divergence import Diverged
from imgtransfer.training.kept import MEASURE
from imgtransfer.training.log import LOG_FILE, log_from
from imgtransfer.training.needs import say_needs
from imgtransfer.training.prepared import remove_prepared
from imgtransfer.training.processes import is_main
from imgtransfer.training.progress_page import PAGE_FILE, Pace, ProgressPage
from imgtransfer.training.remaining import Remaining, say_remaining
from imgtransfer.training.run_folder import CONFIG_FILE, check_steps, only_trainer, state_to_resume
from imgtransfer.training.trackers import Write, check_trackers, trackers
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
            also says which number type it chose, and which model the run began with), report.html with its pictures,
            model.safetensors, state.safetensors, best.safetensors once training has lowered the validation error,
            and earlier checkpoints where they are asked for. Only one training may go on there at a time.
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
    check_trackers(config.training)
    with only_trainer(out) if is_main() else nullcontext():
        resumed = state_to_resume(out, config, resume=resume)
        trainer = Trainer(config)
        if resumed:
            trainer.load(out)
            check_steps(out, config, trainer.step)
        else:
            trainer.fit_head()
        if trainer.processes.main:
            with written_whole(out / CONFIG_FILE) as temporary:
                temporary.write_text(to_yaml(config))
        _log.info("%s", trainer.precision)
        _prepare(trainer, out)
        say_needs(config, config.training.steps - trainer.step, trainer.rehearse)
        Loop(trainer, out, tell).run()
        if trainer.processes.main:
            remove_prepared(out)
    return out / MODEL_FILE


class Loop:
    """The steps that are left of a run: logged, validated and saved; files are the main process' alone.

    Args:
        trainer: at any step.
        out: folder of the run.
        tell: called once with the seconds that are left.
    """

    def __init__(self, trainer: Trainer, out: Path, tell: Callable[[float], None]) -> None:
        self._trainer, self._out = trainer, out
        self._options, self._processes = trainer.config.training, trainer.processes
        self._started, self._begun_at = time.monotonic(), trainer.step
        self._saved_step, self._saved_at = -1, self._started  # by this process
        # With the first line that this process writes.
        self._once = iter([trainer.precision.log_entry() | _begun_with(trainer)])
        self._step_seconds, self._validation_seconds = 0.0, 0.0
        self._page = ProgressPage(trainer, out)
        self._remaining = Remaining(self._options.steps - trainer.step, tell)

    def run(self) -> None:
        """Take the steps, with a bar.

        Raises:
            Diverged: the training is no use going on with; what was saved before stays.
            KeyboardInterrupt: after Ctrl-C or SIGTERM of any process, once the state is saved.
        """
        trainer, steps = self._trainer, self._options.steps
        several = self._processes.count > 1
        bar = tqdm(
            total=steps,
            initial=trainer.step,
            desc="train",
            unit="step",
            file=sys.stderr,
            disable=not self._processes.main,
        )
        with bar, self._log() as write, stop_between_steps(every=several) as stop:
            try:
                stopped = self._steps(bar, write, stop)
            except Diverged as error:
                raise Diverged(f"{self._out}: {error} ({self._kept()})") from error
            if self._saved_step != trainer.step:  # the end, or a stop, perhaps before the first step
                self._save()
            self._processes.any(False)  # none ends, and has the others ended, before all is written
        if stopped:
            _log.info(
                "stopped after step %d; the same command with %s goes on",
                trainer.step,
                Option("resume", True),
            )
            raise stop.error()

    def _steps(self, bar: tqdm, write: Write, stop: Stop) -> bool:
        """Take the steps; whether they were stopped before the last."""
        trainer, options = self._trainer, self._options
        if trainer.step == 0:
            self._enter(write, {"step": 0, "seconds": 0.0, **_data(trainer)}, self._validated(bar))
        elif trainer.best.step == trainer.step:  # a kill may have come between the two
            self._save_best()
        while trainer.step < options.steps:
            if self._processes.any(bool(stop)):
                return True
            before = time.monotonic()
            entry: dict[str, Any] = trainer.train_step()
            self._remaining.step()
            last = trainer.step == options.steps
            self._step_seconds += time.monotonic() - before
            measured = {}
            if last or trainer.step % options.validate_every_steps == 0:
                measured = self._validated(bar)
            every = options.geometry_every_steps
            geometry = trainer.geometry() if every and (last or trainer.step % every == 0) else {}
            seconds = round(time.monotonic() - self._started, 2)
            self._enter(write, {"step": trainer.step, "seconds": seconds, **entry}, measured | geometry)
            bar.update()
            late = time.monotonic() - self._saved_at > SAVE_SECONDS
            if last or late or trainer.step % options.checkpoint_every_steps == 0:
                self._save()
            if trainer.best.step == trainer.step:
                self._save_best()
        return False

    def _validated(self, bar: tqdm) -> dict[str, float]:
        """What the log says of a validation."""
        trainer, before = self._trainer, time.monotonic()
        measured = trainer.validate()
        self._validation_seconds = time.monotonic() - before
        trainer.best.take(measured, trainer.step)
        shown = {key: f"{value:.1f}" for key, value in measured.items() if not key.startswith("guess")}
        bar.set_postfix(shown, refresh=False)
        return measured

    def _enter(self, write: Write, entry: dict[str, Any], measured: dict[str, float]) -> None:
        """Write a line of the log, and after a validation the page."""
        write(entry | measured | next(self._once, {}))
        if MEASURE not in measured or not self._processes.main:
            return
        done = self._trainer.step - self._begun_at
        try:
            self._page.write(Pace(self._step_seconds / done if done else None, self._validation_seconds))
        except OSError as error:  # not worth a training
            _log.warning("note: %s: %s", error.filename or PAGE_FILE, error.strerror or error)

    def _save(self) -> None:
        if self._processes.main:
            self._trainer.save(self._out)
        self._saved_step, self._saved_at = self._trainer.step, time.monotonic()

    def _save_best(self) -> None:
        if self._processes.main:
            self._trainer.save_best(self._out)

    def _kept(self) -> str:
        """What is left of a run that cannot go on."""
        step = max(self._saved_step, self._begun_at)
        return f"what was saved at step {step} is kept" if step > 0 else "nothing was saved yet"

    @contextmanager
    def _log(self) -> Iterator[Write]:
        """What takes the log's entries; that of other processes than the main one does nothing."""
        path = self._out / LOG_FILE
        if path.exists() and self._begun_at > 0:
            entries = {entry["step"]: entry for entry in read_entries(path)[0]}
            self._trainer.watch.resumed(entries[step] for step in sorted(entries) if step <= self._begun_at)
        if not self._processes.main:
            yield lambda _: None
            return
        with (
            log_from(path, self._begun_at) as write,
            trackers(self._trainer.config, self._out, self._begun_at) as track,
        ):

            def both(entry: dict[str, Any]) -> None:
                write(entry)
                track(entry)

            yield both


def _prepare(trainer: Trainer, out: Path) -> None:
    """Compute what is constant for the frames; what is in a file of the run's folder once, by the main process."""
    if trainer.processes.main:
        trainer.prepare(out)
    trainer.processes.any(False)  # the others wait for the file
    if not trainer.processes.main:
        trainer.prepare(out)
    trainer.cache_trunks(out)


def _data(trainer: Trainer) -> dict[str, int]:
    """What the log says of the training clips."""
    frames = trainer.train_frames
    return {"clips": len(frames.readers), "frames": len(frames), "garments": len(frames.outfits)}


def _begun_with(trainer: Trainer) -> dict[str, str | float]:
    """What the log says of the model that the run began with, and of the head that was fitted first."""
    entry: dict[str, str | float] = {}
    if trainer.init_mark is not None:
        entry |= {"init": str(trainer.config.training.init), "init_sha256": trainer.init_mark}
    if (choice := trainer.head_choice) is not None:
        entry |= {
            "head_ridge": choice.ridge,
            "head_reliance": choice.reliance,
            "head_left_out_error": choice.error,
        }
    return entry
