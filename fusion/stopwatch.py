"""Where the seconds of a fusion go."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import torch


class Stopwatch:
    """Wall-clock seconds by stage, summed over its turns and over the threads that take them.

    Args:
        device: what computes; work that is under way on a GPU is waited for, so that each stage pays for its own.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self.seconds: dict[str, float] = {}
        self._lock = Lock()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the seconds of the block to stage `name`."""
        self._wait()
        started = time.perf_counter()
        yield
        self._wait()
        with self._lock:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started

    def _wait(self) -> None:
        if self._device.type == "cuda":
            torch.cuda.synchronize(self._device)
