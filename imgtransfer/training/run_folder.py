"""The folder of a training run: one process at a time, and what may change when the run goes on."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import Any

from imgtransfer.config.loader import load_config
from imgtransfer.training.checkpoint import MODEL_FILE, STATE_FILE
from imgtransfer.training.config import RunConfig
from imgtransfer.training.optimizer import learning_rate
from render import InputError, Option

_log = logging.getLogger(__name__)

CONFIG_FILE = "config.yaml"
LOCK_FILE = ".lock"  # while a process trains there
# What the order of the frames does not hang on, or is the machine's, so that a run may go on with other values.
FREE_ON_RESUME = frozenset(
    f"training.{key}"
    for key in (
        "steps",
        "precision",
        "device",
        "threads",
        "stored",
        "trunk_cache_gb",
        "accumulate",  # the frames of a step must stay as many, which the trainer checks
        "deterministic",
        "validate_every_steps",
        "geometry_every_steps",
        "geometry_frames",
        "checkpoint_every_steps",
        "keep_checkpoints",
        "tensorboard",
        "wandb",
    )
)


@contextmanager
def only_trainer(out: Path) -> Iterator[None]:
    """Keep other processes from training in `out`; it is made, and removed again if nothing was saved in it.

    Raises:
        InputError: another process, which is named, trains there.
    """
    new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    path = out / LOCK_FILE
    handle = _locked(path, out)
    try:
        os.ftruncate(handle, 0)
        os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)
        if new:
            with suppress(OSError):  # it holds a run
                out.rmdir()


def _locked(path: Path, out: Path) -> int:
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            flock(handle, LOCK_EX | LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(handle, 200).decode(errors="replace") or "another process"
            os.close(handle)
            raise InputError(
                f"{out}: {holder} is training there; wait for it, stop it, or choose another {Option('out')}"
            ) from error
        except OSError:  # a file system without locks
            return handle
        with suppress(FileNotFoundError):
            if path.stat().st_ino == os.fstat(handle).st_ino:
                return handle
        os.close(handle)  # its last holder has just removed it


def state_to_resume(out: Path, config: RunConfig, *, resume: bool) -> bool:
    """Whether `out` holds a state to go on from; where it does not, the run begins at step 0.

    Raises:
        InputError: without `resume`, a run that has saved something; with it, no run, one of another configuration, or
            one whose files are not complete.
    """
    saved = [name for name in (STATE_FILE, MODEL_FILE) if (out / name).exists()]
    begun = (out / CONFIG_FILE).exists()
    if not resume:
        if saved:
            raise InputError(
                f"{out}: holds a run already; add {Option('resume', True)} to go on with it, or choose another "
                f"{Option('out')}"
            )
        if begun:
            _note(f"{out}: the run there was stopped before it saved anything; it begins anew")
        return False
    if saved and not begun:
        raise InputError(
            f"{out}: cannot resume, {CONFIG_FILE} is missing; choose another {Option('out')} for a new run"
        )
    if STATE_FILE in saved:
        _check_same(out, config)
        return True
    if saved:
        raise InputError(
            f"{out / STATE_FILE}: missing, so that the run cannot go on, though {MODEL_FILE} is there; choose another "
            f"{Option('out')} for a new run"
        )
    if not begun and any(entry.name != LOCK_FILE for entry in out.iterdir()):
        raise InputError(
            f"{out}: no run to resume there (no {CONFIG_FILE}); leave out {Option('resume')} to start one"
        )
    _note(f"{out}: nothing was saved there yet; the run begins at step 0")
    return False


def _check_same(out: Path, config: RunConfig) -> None:
    """Raise InputError where a setting that decides the result has changed; say which others have."""
    changed = _changed(load_config(RunConfig, out / CONFIG_FILE), config)
    for key, text in changed.items():
        if key not in FREE_ON_RESUME:
            raise InputError(
                f"{out}: cannot resume, {text}; set it back, or start a new run with another {Option('out')}"
            )
    if changed:
        _note(f"{out}: " + ", ".join(changed.values()))


def may_go_on(before: RunConfig, now: RunConfig) -> bool:
    """Whether a run of the one configuration may go on with the other."""
    return set(_changed(before, now)) <= FREE_ON_RESUME


def check_steps(out: Path, config: RunConfig, step: int) -> None:
    """Say what another number of steps does to the learning rate of a run that is at `step`.

    Raises:
        InputError: fewer steps than the run has done already.
    """
    options, before = config.training, load_config(RunConfig, out / CONFIG_FILE).training
    if options.steps < step:
        raise InputError(
            f"{out}: training.steps is {options.steps}, but the run has done {step} already; at least {step} are wanted"
        )
    if options.steps != before.steps and options.schedule != "constant" and step < options.steps:
        rates = [learning_rate(of, min(step, of.steps)) for of in (options, before)]
        _note(
            f"{out}: the {options.schedule} schedule follows the new number of steps; the learning rate is "
            f"{rates[0]:.2g} where it was {rates[1]:.2g}"
        )


def _changed(before: RunConfig, now: RunConfig) -> dict[str, str]:
    """By key, how each value that differs has changed."""
    old, new = _flat(before), _flat(now)
    return {key: f"{key} is {new[key]} now and was {old[key]}" for key in new if old[key] != new[key]}


def _flat(config: RunConfig) -> dict[str, Any]:
    sections = config.model_dump(mode="json").items()
    return {f"{section}.{key}": value for section, values in sections for key, value in values.items()}


def _note(text: str) -> None:
    _log.warning("note: %s", text)
