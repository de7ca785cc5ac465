"""What a training will need, said before its first step."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from imgtransfer.network.memory import training_bytes
from imgtransfer.training.config import RunConfig
from imgtransfer.training.remaining import duration

_log = logging.getLogger(__name__)

_LONG_S = 10.0  # a step that takes so long is not tried twice


def say_needs(
    config: RunConfig, steps: int, rehearse: Callable[[], None], clock: Callable[[], float] = time.monotonic
) -> None:
    """Log how much memory and time `steps` more steps of a run need.

    Args:
        config: of the run.
        rehearse: does what takes the time of a step, and changes nothing (`Trainer.rehearse`).
        clock: seconds that pass.
    """
    if steps <= 0:
        return
    options = config.training
    memory = training_bytes(
        config.network,
        config.maps,
        batch_frames=options.batch_frames,
        averaged=options.ema is not None,
    )
    for _ in range(2):  # the first also reads data, and finds room
        begun = clock()
        rehearse()
        taken = clock() - begun
        if taken > _LONG_S:
            break
    _log.info(
        "networks and batches need about %s of memory, and %d steps about %s on this machine",
        f"{memory / 1e9:.1f} GB" if memory >= 1e9 else f"{memory / 1e6:.0f} MB",
        steps,
        duration(steps * taken),
    )
