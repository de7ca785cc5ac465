"""Independent pieces of work on the CPU's cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")

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


def be_one_of_many(torch_threads: int = 1) -> None:
    """For the start of a thread that is one of several: nothing in it starts threads of its own, but torch so many."""
    torch.set_num_threads(torch_threads)  # OpenMP counts by thread
    _threads.set(1)


def in_order(
    call: Callable[[Item], Result], items: Iterable[Item], *, threads: int, torch_threads: int = 1
) -> Iterator[Result]:
    """What `call` gives of every item, in their order; from several threads, if they let go of Python's lock.

    Items are taken, and results wait, on the caller's thread: what it does with a result is done while others are made.

    Args:
        call: of one item, on any thread.
        items: no more are asked for than keep the threads busy.
        threads: how many; 1 makes no thread, and each result when it is asked for.
        torch_threads: how many torch may use in each of several threads.

    Raises:
        Whatever `call` or `items` raises, in its turn.
    """
    if threads == 1:
        yield from map(call, items)
        return
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(threads, "batch", be_one_of_many, (torch_threads,)) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(call, item))
                if len(waiting) > threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


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
