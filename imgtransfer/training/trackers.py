"""Where the log of a run also goes: TensorBoard, and Weights & Biases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.config import RunConfig, TrainingConfig
from render.extras import check_installed, optional

TENSORBOARD_FOLDER = "tensorboard"
Write = Callable[[dict[str, Any]], None]


def check_trackers(options: TrainingConfig) -> None:
    """Raise InputError where a package that the run shall log to is missing, before anything is computed."""
    if options.tensorboard:
        check_installed("tensorboard", "training.tensorboard", "tensorboard")
    if options.wandb is not None:
        check_installed("wandb", "training.wandb", "wandb")


@contextmanager
def trackers(config: RunConfig, out: Path, step: int) -> Iterator[Write]:
    """What takes the log's entries to where the configuration wants them, besides the log.

    Args:
        config: of the run. out: its folder. step: that it is at; what was sent of later ones before a kill is dropped.
    """
    with ExitStack() as stack:
        writers: list[Write] = []
        if config.training.tensorboard:
            writers.append(stack.enter_context(_tensorboard(out / TENSORBOARD_FOLDER, step)))
        if config.training.wandb is not None:
            writers.append(stack.enter_context(_wandb(config, config.training.wandb, out)))

        def write(entry: dict[str, Any]) -> None:
            for writer in writers:
                writer(entry)

        yield write


@contextmanager
def _tensorboard(folder: Path, step: int) -> Iterator[Write]:
    optional("tensorboard", "tensorboard", "training.tensorboard")
    from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415

    with SummaryWriter(str(folder), purge_step=step + 1 if step else None) as writer:

        def write(entry: dict[str, Any]) -> None:
            for name, value in _numbers(entry).items():
                writer.add_scalar(name, value, entry["step"])

        yield write


@contextmanager
def _wandb(config: RunConfig, project: str, out: Path) -> Iterator[Write]:
    wandb = optional("wandb", "wandb", "training.wandb")
    run = wandb.init(
        project=project,
        name=out.name,
        id=fingerprint([str(out.resolve())]),  # so that a resumed run goes on there
        resume="allow",
        dir=str(out),
        config=config.model_dump(mode="json"),
    )
    try:
        yield lambda entry: run.log(_numbers(entry), step=entry["step"])
    finally:
        run.finish()


def _numbers(entry: dict[str, Any]) -> dict[str, float]:
    """What an entry measures; not the step that it is about."""
    return {
        name: value
        for name, value in entry.items()
        if name != "step" and isinstance(value, int | float) and not isinstance(value, bool)
    }
