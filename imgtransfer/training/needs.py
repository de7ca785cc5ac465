"""What a training will need, said before its first step."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from imgtransfer.network.memory import training_bytes
from imgtransfer.training.config import RunConfig
from imgtransfer.training.remaining import duration

_log = logging.getLogger(__name__)

# Steps of other frames each, as each garment takes its own time; the first also reads data, and finds room.
_TRIED = 4
_LONG_S = 10.0  # once so much has passed, no more are tried


def say_needs(
    config: RunConfig,
    steps: int,
    rehearse: Callable[[int], None],
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Log how much memory and time `steps` more steps of a run need.

    Args:
        config: of the run.
        rehearse: does what takes the time of the next step, or that of so many after it, and changes nothing
            (`Trainer.rehearse`).
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
    passed = [clock()]
    for ahead in range(min(_TRIED, steps)):
        rehearse(ahead)
        passed.append(clock())
        if passed[-1] - passed[0] > _LONG_S:
            break
    counted = passed[1:] if len(passed) > 2 else passed
    taken = (counted[-1] - counted[0]) / (len(counted) - 1)
    _log.info(
        "networks and batches need about %s of memory, and %d steps about %s on this machine",
        f"{memory / 1e9:.1f} GB" if memory >= 1e9 else f"{memory / 1e6:.0f} MB",
        steps,
        duration(steps * taken),
    )
