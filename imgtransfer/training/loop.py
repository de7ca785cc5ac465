"""A training run from start to end: logged, validated, stopped and resumed."""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from imgtransfer.training.checkpoint import MODEL_FILE
from imgtransfer.training.config import RunConfig, difference, load_config, to_yaml
from imgtransfer.training.remaining import Remaining, say_remaining
from imgtransfer.training.trainer import Trainer
from render import InputError
from render.files import written_whole

CONFIG_FILE, LOG_FILE = "config.yaml", "log.jsonl"


def train(
    config: RunConfig, out: Path, *, resume: bool = False, tell: Callable[[float], None] = say_remaining
) -> Path:
    """Train to the end and write the results.

    Args:
        config: the run.
        out: folder for config.yaml, log.jsonl (a line a step and a validation; the first line that a process writes
            also says which number type it chose), model.safetensors, state.safetensors.
        resume: go on with the run in `out`.
        tell: called once with the seconds that are left, after the first steps.

    Returns:
        The model's file.

    Raises:
        InputError: bad data or configuration; a run in `out` already, or none to resume, or one of another
            configuration.
        KeyboardInterrupt: after Ctrl-C, once the state is saved.
    """
    _check_folder(config, out, resume)
    trainer = Trainer(config)
    if resume:
        trainer.load(out)
    with written_whole(out / CONFIG_FILE) as temporary:
        temporary.write_text(to_yaml(config))
    print(trainer.precision, file=sys.stderr)
    options, started = config.training, time.monotonic()
    bar = tqdm(total=options.steps, initial=trainer.step, desc="train", unit="step", file=sys.stderr)
    log = _log(out / LOG_FILE, trainer.step, note=trainer.precision.log_entry())
    with bar, log as write, _interrupts() as interrupted:
        if trainer.step == 0:
            write({"step": 0, "seconds": 0.0, **trainer.validate()})
        remaining = Remaining(options.steps - trainer.step, tell)
        while trainer.step < options.steps and not interrupted.is_set():
            entry: dict[str, Any] = trainer.train_step()
            with bar.external_write_mode(file=sys.stderr):
                remaining.step()
            last = trainer.step == options.steps
            if last or trainer.step % options.validate_every_steps == 0:
                measured = trainer.validate()
                entry |= measured
                shown = {k: f"{v:.1f}" for k, v in measured.items() if not k.startswith("guess")}
                bar.set_postfix(shown, refresh=False)
            write({"step": trainer.step, "seconds": round(time.monotonic() - started, 2), **entry})
            bar.update()
            if last or trainer.step % options.checkpoint_every_steps == 0:
                trainer.save(out)
        if trainer.step < options.steps:  # stopped, perhaps before the first step
            trainer.save(out)
    if trainer.step < options.steps:
        print(f"stopped after step {trainer.step}; the same command with --resume goes on", file=sys.stderr)
        raise KeyboardInterrupt
    return out / MODEL_FILE


def _check_folder(config: RunConfig, out: Path, resume: bool) -> None:
    stored = out / CONFIG_FILE
    if not resume:
        if stored.exists():
            raise InputError(
                f"{out}: holds a run already; add --resume to go on with it, or choose another --out"
            )
        return
    if not stored.exists():
        raise InputError(f"{out}: no run to resume there (no {CONFIG_FILE}); leave out --resume to start one")
    if changed := difference(load_config(stored), config):
        raise InputError(
            f"{out}: cannot resume, {changed}; set it back, or start a new run with another --out"
        )


@contextmanager
def _log(path: Path, step: int, *, note: dict[str, Any]) -> Iterator[Callable[[dict[str, Any]], object]]:
    """A function that appends a JSON line, the first one with `note`; lines after `step`, of a run that died since, are
    dropped before.
    """
    if path.exists():
        lines = [line for line in path.read_text().splitlines() if json.loads(line)["step"] <= step]
        with written_whole(path) as temporary:
            temporary.write_text("".join(f"{line}\n" for line in lines if step))
    with path.open("a", buffering=1) as file:
        notes = iter([note])
        yield lambda entry: file.write(json.dumps(entry | next(notes, {})) + "\n")


@contextmanager
def _interrupts() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, so that the step under way ends whole; the second one stops at
    once.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event  # signals reach the main thread only
        return

    def handle(number: int, frame: Any) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, handle)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)
