"""Which frame it is: a clip that plays drops frames rather than falling behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Clock:
    """Plays a clip over and over.

    Args:
        now: seconds of a clock that only rises.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._lock = now, threading.Lock()
        self.n_frames, self._rate, self._playing = 1, 30.0, False
        self._from, self._since = 0.0, now()

    def start(self, n_frames: int, rate: float) -> None:
        """Begin with the first frame of a clip, at so many frames a second."""
        with self._lock:
            self.n_frames, self._rate = max(1, n_frames), rate
            self._from, self._since = 0.0, self._now()

    def set(self, playing: bool, rate: float) -> None:
        """Play or pause, at so many frames a second from now on."""
        with self._lock:
            if (playing, rate) != (self._playing, self._rate):
                self._from, self._since = self._at(), self._now()
                self._playing, self._rate = playing, rate

    def go_to(self, frame: int) -> None:
        """Go on from a frame; from the last one on for what lies beyond it, and so on."""
        with self._lock:
            self._from, self._since = float(frame % self.n_frames), self._now()

    def frame(self) -> int:
        """The frame of now."""
        with self._lock:
            return int(self._at() + 1e-6) % self.n_frames

    def until_next(self) -> float:
        """Seconds until the next frame of a clip that plays."""
        with self._lock:
            at = self._at() + 1e-6
            return max(0.0, (1 - at % 1) / self._rate)

    def _at(self) -> float:
        """The frame of now with what has passed of it, from 0 up to `n_frames`."""
        passed = (self._now() - self._since) * self._rate if self._playing else 0.0
        return (self._from + passed) % self.n_frames
