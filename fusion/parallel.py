"""Independent pieces of work on the CPU's cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache

import torch

_threads: ContextVar[int | None] = ContextVar("threads", default=None)


def n_threads() -> int:
    """How many threads may be kept busy: as many as torch has, or had outside of `one_torch_thread`."""
    allowed = _threads.get()
    return torch.get_num_threads() if allowed is None else allowed


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch to one CPU thread inside the block, and leave the others to whoever asks `n_threads`.

    A step is a few dozen products of some 0.1 ms each, and torch's threads wait for each other at every one. On a
    machine in use, two of them took between 0.86 times and 4 times as long as one, depending on what else ran
    (4,400 and 12,100 vertices, scripts/bench/fusion.py).
    """
    threads = torch.get_num_threads()
    token = _threads.set(n_threads())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        _threads.reset(token)


def be_one_of_many() -> None:
    """For the start of a thread that is one of several: nothing in it starts threads of its own."""
    torch.set_num_threads(1)  # OpenMP counts by thread
    _threads.set(1)


def run_all(pieces: Sequence[Callable[[], None]]) -> None:
    """Run all pieces, each on a thread of its own; they must let go of Python's lock to gain from that."""
    if len(pieces) == 1:
        pieces[0]()
        return
    others = [_pool(len(pieces) - 1).submit(piece) for piece in pieces[1:]]
    pieces[0]()
    for other in others:
        other.result()


@cache
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="fusion")
