"""A pool of processes that survives the death of any of them.

Unlike `multiprocessing.Pool`, which waits for ever for what a killed worker was doing, and `concurrent.futures`, which
gives up all tasks under way, this knows which task died with its process, and does that one again.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from imgtransfer.running.task import Outcome, attempt, call_packed, pack
from imgtransfer.running.waiting import passive_waiting

T = TypeVar("T")
R = TypeVar("R")
_TORCH_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
_PATIENCE = 3.0  # seconds that a process has to end before it is killed


@dataclass(frozen=True)
class Pool:
    """Tasks over several processes of this machine, each a fresh interpreter (Warp and GL must not be forked).

    Args:
        workers: processes.
        retries: how often a task is done again whose process died.
        threads: of torch in each process; None shares the cores out. BLAS has one, as `attempt` says.
    """

    workers: int
    retries: int = 2
    threads: int | None = None

    def outcomes(self, function: Callable[[T], R], tasks: Sequence[T]) -> Generator[Outcome[R], None, None]:
        left, deaths = deque(range(len(tasks))), Counter[int]()
        count = min(self.workers, len(tasks))
        threads = str(self.threads or max(1, _cores() // max(1, count)))
        environment = dict.fromkeys(_TORCH_VARIABLES, threads) | passive_waiting()
        environment["OPENBLAS_NUM_THREADS"] = "1"  # else it starts threads that no task uses
        workers: list[_Worker] = []
        try:
            for _ in range(count):
                workers.append(_Worker(environment))
            while left or any(worker.busy for worker in workers):
                for place, worker in enumerate(workers):
                    if left and not worker.busy:
                        if not worker.alive:
                            worker.stop()
                            worker = workers[place] = _Worker(environment)  # noqa: PLW2901
                        index = left.popleft()
                        worker.give(index, function, tasks[index])
                wait([handle for worker in workers if worker.busy for handle in worker.handles])
                for worker in workers:
                    if (ended := worker.take()) is None:
                        continue
                    index, outcome = ended
                    if outcome is None and deaths[index] < self.retries:
                        deaths[index] += 1
                        left.append(index)
                        continue
                    died = f"its process died {self.retries + 1} times, the last time with exit status {worker.status}"
                    yield outcome or Outcome(index, reason=died)
        finally:
            for worker in workers:
                worker.dismiss()
            for worker in workers:
                worker.stop()


class _Worker:
    """A process and the task that it does."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        self._task: int | None = None
        with _environment(environment), _no_interrupts():
            self._process.start()
        theirs.close()  # so that its death ends the connection

    @property
    def busy(self) -> bool:
        return self._task is not None

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    @property
    def status(self) -> int | None:
        """Exit status, -9 where it was killed."""
        return self._process.exitcode

    @property
    def handles(self) -> list[Any]:
        """What becomes ready when it has a result or dies."""
        return [self._connection, self._process.sentinel]

    def give(self, index: int, function: Callable[[T], R], task: T) -> None:
        """Start a task."""
        self._task = index
        with suppress(BrokenPipeError, ConnectionResetError):  # it died meanwhile; `take` will say so
            self._connection.send((index, pack(function, task)))

    def take(self) -> tuple[int, Outcome[Any] | None] | None:
        """The task that has ended and its outcome, None where the process died; None while it goes on."""
        if self._task is None:
            return None
        index = self._task
        with suppress(EOFError, ConnectionResetError):
            if self._connection.poll():
                outcome = self._connection.recv()
                self._task = None
                return index, outcome
            if self._process.is_alive():
                return None
        self._process.join(_PATIENCE)
        self._task = None
        return index, None

    def dismiss(self) -> None:
        """Tell the process that no task will come; one that does nothing then ends by itself and cleans up."""
        self._connection.close()

    def stop(self) -> None:
        """End the process, whatever it does."""
        self.dismiss()
        if not self.busy:
            self._process.join(_PATIENCE)
        self._process.terminate()
        self._process.join(_PATIENCE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _work(connection: Connection) -> None:
    """What a process does: tasks from the connection, until that or the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its processes
    signal.signal(
        signal.SIGTERM, lambda number, _: sys.exit(128 + number)
    )  # by this: what is half-written goes
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            index, packed = connection.recv()
        except EOFError:
            return
        outcome: Outcome[Any] = attempt(call_packed, packed, index)
        try:
            connection.send(outcome)
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            connection.send(Outcome(index, reason=f"its result cannot be sent: {error}"))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Processes that are started in here see these variables."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Processes that are started in here ignore Ctrl-C, from their first moment on: this process stops them."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals can be set in the main thread only
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
