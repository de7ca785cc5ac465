"""How long a training will take, said once, after its first steps."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field

_log = logging.getLogger(__name__)

_FIRST, _MEASURED = 2, 4  # steps that warm up, and steps that are timed


@dataclass
class Remaining:
    """Tells what is left of a run, in time.

    Args:
        steps: of the run that are still to do.
        tell: called once with the seconds left; not for a run that is over before they are known.
        clock: seconds that pass.
    """

    steps: int
    tell: Callable[[float], None]
    clock: Callable[[], float] = time.monotonic
    _times: list[float] = field(default_factory=list)

    def step(self) -> None:
        """To be called after every step."""
        self.steps -= 1
        if len(self._times) > _FIRST + _MEASURED:
            return
        self._times.append(self.clock())
        if len(self._times) == _FIRST + _MEASURED + 1 and self.steps > 0:
            self.tell(self.steps * (self._times[-1] - self._times[_FIRST]) / _MEASURED)


def say_remaining(seconds: float) -> None:
    """Log the time."""
    _log.info("training takes about %s on this machine", duration(seconds))


def duration(seconds: float) -> str:
    """Seconds in words, as roughly as they are known: "40 seconds", "5 minutes", "3 hours"."""
    for unit, length in (("hour", 3600.0), ("minute", 60.0)):
        if seconds >= 1.5 * length:
            return f"{round(seconds / length)} {unit}s"
    return "a minute" if seconds >= 50 else f"{max(10, 10 * round(seconds / 10))} seconds"
