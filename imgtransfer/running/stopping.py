"""Ctrl-C and SIGTERM, which clusters send: the first stops a command tidily, the second at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


class Terminated(KeyboardInterrupt):
    """SIGTERM, treated as Ctrl-C but for the exit status."""


@contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """In here, a SIGTERM raises `Terminated` where the main thread is, as Ctrl-C raises KeyboardInterrupt; a second one
    ends the process on the spot.
    """
    if not _may_handle() or signal.getsignal(signal.SIGTERM) is signal.SIG_IGN:
        yield
        return

    def handle(number: int, frame: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise Terminated

    before = signal.signal(signal.SIGTERM, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


@dataclass
class Stop:
    """Whether a signal has asked to stop, and which.

    Args:
        number: of the first signal; 0 while there was none.
    """

    number: int = 0

    def __bool__(self) -> bool:
        return self.number != 0

    def error(self) -> KeyboardInterrupt:
        """What to raise once everything is saved."""
        return Terminated() if self.number == signal.SIGTERM else KeyboardInterrupt()


@contextmanager
def stop_between_steps(*, every: bool = False) -> Iterator[Stop]:
    """In here, the first Ctrl-C or SIGTERM only sets the `Stop`, so that a step under way ends whole; the next one does
    what it did outside.

    Args:
        every: whether every further one does no more than the first: launchers of several processes send each of them
            one besides the one that the terminal has sent, and end those that take too long.
    """
    stop = Stop()
    if not _may_handle():
        yield stop
        return
    before: dict[int, Any] = {}

    def handle(number: int, frame: Any) -> None:
        stop.number = stop.number or number
        if not every:
            restore()

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)

    for asked in (signal.SIGINT, signal.SIGTERM):
        before[asked] = signal.getsignal(asked)
    try:
        for asked in (signal.SIGINT, signal.SIGTERM):
            signal.signal(asked, handle)
        yield stop
    finally:
        restore()


def _may_handle() -> bool:
    """Whether this is the main thread, the only one that signals reach."""
    return threading.current_thread() is threading.main_thread()
