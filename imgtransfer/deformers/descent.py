"""Gradient descent of the compared methods: with a bar, logged, stopped between steps, and gone on with to the bit."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor, nn
from tqdm import tqdm

from imgtransfer.deformers.base import FitFolder
from imgtransfer.running.stopping import stop_between_steps
from imgtransfer.training.checkpoint import FORMAT_VERSION, optimizer_state, read_tensors, write_tensors
from imgtransfer.training.log import log_from
from imgtransfer.training.optimizer import moments, set_moments
from render import InputError, Option

_log = logging.getLogger(__name__)

STATE_FORMAT = "imgtransfer-deformer-state"
SAVE_SECONDS = 300.0  # between two states at most


def descend(
    module: nn.Module,
    loss: Callable[[int], dict[str, Tensor]],
    *,
    stage: str,
    steps: int,
    learning_rate: Callable[[int], float],
    folder: FitFolder,
    weight_decay: float = 0.0,
    gradient_clip: float | None = None,
) -> None:
    """Minimise a sum of losses by Adam (AdamW where there is weight decay).

    A stage that has ended is only read back; one that was stopped goes on. Steps follow from `folder.seed` and their
    number alone, so `loss` must draw what it draws at random from a generator seeded by them.

    Args:
        module: whose parameters are fitted, in place.
        loss: the step's number to named terms, scalars, whose sum is minimised.
        stage: names the bar, the state FOLDER/STAGE.safetensors and the log FOLDER/STAGE.jsonl.
        steps: in all.
        learning_rate: of step 0, 1, ...
        folder: of the fit.
        weight_decay, gradient_clip: as their names say; the clip is of the whole gradient's norm.

    Raises:
        InputError: a state that is damaged or of another module; a loss that is not finite.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, once the state is saved.
    """
    kind = torch.optim.AdamW if weight_decay else torch.optim.Adam
    optimizer = kind(module.parameters(), lr=learning_rate(0), weight_decay=weight_decay)
    path = folder.path / f"{stage}.safetensors"
    step = _load(path, module, optimizer)
    saved_at = time.monotonic()
    bar = tqdm(total=steps, initial=step, desc=stage, unit="step", file=sys.stderr, disable=None)
    with bar, log_from(folder.path / f"{stage}.jsonl", step) as write, stop_between_steps() as stop:
        module.train()
        while step < steps and not stop:
            rate = learning_rate(step)
            for group in optimizer.param_groups:
                group["lr"] = rate
            torch.manual_seed(
                hash((folder.seed, step)) & 0x7FFFFFFF
            )  # dropout and the like, the same when resumed
            terms = loss(step)
            total = torch.stack(list(terms.values())).sum()
            if not bool(total.isfinite()):
                raise InputError(
                    f"{folder.path}: the loss of {stage} is not finite at step {step}; lower the learning rate, or "
                    "look at the training clips with imgtransfer inspect"
                )
            optimizer.zero_grad()
            total.backward()
            if gradient_clip is not None:
                nn.utils.clip_grad_norm_(module.parameters(), gradient_clip)
            optimizer.step()
            step += 1
            write(
                {"step": step, **{key: value.item() for key, value in terms.items()}, "learning_rate": rate}
            )
            bar.update()
            if time.monotonic() - saved_at > SAVE_SECONDS:
                _save(path, module, optimizer, step)
                saved_at = time.monotonic()
        _save(path, module, optimizer, step)
    module.eval()
    if step < steps:
        _log.info(
            "stopped in %s after step %d; the same command with %s goes on",
            stage,
            step,
            Option("resume", True),
        )
        raise stop.error()


def _save(path: Path, module: nn.Module, optimizer: torch.optim.Optimizer, step: int) -> None:
    tensors = {f"model.{key}": value for key, value in module.state_dict().items()}
    for number, its in moments(module, optimizer).items():
        tensors |= {f"optimizer.{number}.{key}": value for key, value in its.items()}
    write_tensors(path, tensors, {"format": STATE_FORMAT, "format_version": FORMAT_VERSION, "step": step})


def _load(path: Path, module: nn.Module, optimizer: torch.optim.Optimizer) -> int:
    """Put back a stage's state, where there is one; the step that it is at."""
    if not path.exists():
        return 0
    tensors, header = read_tensors(path, STATE_FORMAT)
    step = header.get("step")
    if not isinstance(step, int) or isinstance(step, bool) or step < 0:
        raise InputError(
            f"{path}: damaged, its step is {step!r}; choose another {Option('out')} for a new run"
        )
    weights = {
        key.removeprefix("model."): value for key, value in tensors.items() if key.startswith("model.")
    }
    try:
        module.load_state_dict(weights, strict=True)
    except RuntimeError as error:
        raise InputError(
            f"{path}: of another method or other settings than this run's; choose another {Option('out')} for a new run"
        ) from error
    state = optimizer_state(tensors, list(module.parameters()), path, begun=step > 0)
    set_moments(module, optimizer, state)
    return step
