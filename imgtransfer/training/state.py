"""The state of a run on disk, from which it goes on bit for bit: weights, optimiser, average, what it began with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from imgtransfer.network import TransferModel
from imgtransfer.network.kernel_head import LeftOut
from imgtransfer.training.averaging import WeightAverage
from imgtransfer.training.checkpoint import (
    FORMAT_VERSION,
    STATE_FILE,
    STATE_FORMAT,
    averaged_weights,
    load_weights,
    optimizer_state,
    read_tensors,
    write_tensors,
)
from imgtransfer.training.divergence import check_finite_weights
from imgtransfer.training.head_state import left_out_heads
from imgtransfer.training.kept import Best
from imgtransfer.training.optimizer import moments, set_moments
from render import InputError, Option


@dataclass(frozen=True, eq=False)
class Learner:
    """What a training changes.

    Args:
        model: its weights.
        optimizer: of the model's parameters.
        average: of the weights, where they are averaged.
    """

    model: TransferModel
    optimizer: torch.optim.Optimizer
    average: WeightAverage | None


@dataclass(frozen=True)
class Origin:
    """What a run began with, and goes on with alone.

    Args:
        init: SHA-256 of the model that it began with, if any.
        data: fingerprints of the training and of the validation clips.
        frames_a_step: of all batches and processes.
        named: the configuration's name of the model.
    """

    init: str | None
    data: dict[str, str]
    frames_a_step: int
    named: Path | None


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Args:
        step: number of steps done.
        best: validation so far.
    """

    step: int
    best: Best


def save_state(
    folder: Path,
    learner: Learner,
    left_out: LeftOut | None,
    *,
    origin: Origin,
    progress: Progress,
    advice: str,
) -> Path:
    """Write the state, whole or not at all.

    Args:
        folder: of the run. advice: what to try where the training has diverged.

    Raises:
        Diverged: a weight is not finite; nothing is written then.
        InputError: it cannot be written, such as for want of space.
    """
    model = learner.model
    tensors = {f"model.{key}": value for key, value in model.state_dict().items()}
    for number, its in moments(model, learner.optimizer).items():
        tensors |= {f"optimizer.{number}.{key}": value for key, value in its.items()}
    if learner.average is not None:
        tensors |= {f"average.{key}": value for key, value in learner.average.tensors().items()}
    if left_out is not None:
        tensors |= {f"left_out.{key}": value for key, value in left_out.tensors().items()}
    check_finite_weights(tensors, progress.step, advice)
    header = {
        "format": STATE_FORMAT,
        "format_version": FORMAT_VERSION,
        "step": progress.step,
        **_box(model),
        "init": origin.init,
        "data": origin.data,
        "frames_a_step": origin.frames_a_step,
        "best": progress.best.header(),
    }
    return write_tensors(folder / STATE_FILE, tensors, header)


def load_state(
    folder: Path, learner: Learner, origin: Origin, group: Tensor
) -> tuple[Progress, LeftOut | None]:
    """Put back what `save_state` wrote.

    Args:
        folder: of the run. group: (T,) int64, with which clips each training frame is left out (`LeftOut`).

    Returns:
        How far the run is; the heads of left-out clips, where the model has a head.

    Raises:
        InputError: a state that is damaged, of another architecture, or of a run that began with something else.
    """
    path = folder / STATE_FILE
    tensors, header = read_tensors(path, STATE_FORMAT)
    step = header.get("step")
    if not isinstance(step, int) or isinstance(step, bool) or step < 0:
        raise InputError(
            f"{path}: damaged, its step is {step!r}; choose another {Option('out')} for a new run"
        )
    model = learner.model
    _check_origin(path, header, model, origin)
    load_weights(model, tensors, path)
    left_out = None if model.head is None else left_out_heads(tensors, model.head, group, path)
    state = optimizer_state(tensors, list(model.parameters()), path, begun=step > 0)
    set_moments(model, learner.optimizer, state)
    if learner.average is not None:
        learner.average.load(averaged_weights(tensors, model, path))
    return Progress(step, Best.of_header(header.get("best"))), left_out


def _check_origin(path: Path, header: dict[str, Any], model: TransferModel, origin: Origin) -> None:
    """Raise InputError where the run began with something else; earlier versions did not write all of it."""
    if {key: header.get(key) for key in _box(model)} != _box(model):
        raise InputError(
            f"{path}: the training data have changed since; start a new run with another {Option('out')}"
        )
    known = header.get("data")
    for part, mark in origin.data.items():
        if isinstance(known, dict) and known.get(part) != mark:
            raise InputError(
                f"{path}: the run began with other {part} clips (names, lengths, first frames, template or body "
                f"differ); put those back, or start a new run with another {Option('out')}"
            )
    if header.get("init") != origin.init:
        raise InputError(
            f"{path}: the run began with another model than {origin.named} is now; put that one "
            f"back, or start a new run with another {Option('out')}"
        )
    frames = header.get("frames_a_step", origin.frames_a_step)
    if frames != origin.frames_a_step:
        raise InputError(
            f"{path}: a step of this run takes {frames} frames, and would now take {origin.frames_a_step}; start as "
            "many processes as before, or set training.accumulate so that the product is the same"
        )


def _box(model: TransferModel) -> dict[str, list[float]]:
    """The position box as headers have it."""
    return {"box_lo": model.box.lo.tolist(), "box_hi": model.box.hi.tolist()}
