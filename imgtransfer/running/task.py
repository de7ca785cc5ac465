"""One task, how it ends, and what runs many of them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import traceback
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from imgtransfer.running.memory import shortage
from imgtransfer.running.messages import notes_on_stderr
from render import InputError
from render.options import current_naming, options_named
from render.threads import one_blas_thread

T = TypeVar("T")
R = TypeVar("R")
WORKER_VARIABLE = "IMGTRANSFER_WORKER"  # set in the environment of Ray's workers


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """How a task ended.

    Args:
        index: which of the tasks.
        value: what the function returned; None where it failed.
        reason: one line, why it failed; None where it did not.
        details: the traceback, where the failure was not the user's.
    """

    index: int
    value: R | None = None
    reason: str | None = None
    details: str = ""


class Executor(Protocol):
    """Runs tasks, each in one process."""

    def outcomes(self, function: Callable[[T], R], tasks: Sequence[T]) -> Generator[Outcome[R], None, None]:
        """Yield an outcome for every task, as they end; closing the generator stops the work.

        Args:
            function: of a module, so that other processes can import it; it and tasks and results are pickled.
        """
        ...


@dataclass(frozen=True)
class Serial:
    """One task after another in this process."""

    def outcomes(self, function: Callable[[T], R], tasks: Sequence[T]) -> Generator[Outcome[R], None, None]:
        for index, task in enumerate(tasks):
            yield attempt(function, task, index)


def attempt(function: Callable[[T], R], task: T, index: int) -> Outcome[R]:
    """Call the function; an exception is an outcome, too, so that one bad clip does not end the others.

    Whatever runs it, a task has one BLAS thread: its result does not depend on how many tasks run beside it.
    """
    try:
        with one_blas_thread():
            return Outcome(index, function(task))
    except InputError as error:
        return Outcome(index, reason=str(error))
    except OSError as error:  # no permission, a full disk, a file where a folder is wanted
        return Outcome(index, reason=f"{error.filename or 'files'}: {error.strerror or error}")
    except Exception as error:
        if lack := shortage(error):
            return Outcome(index, reason=lack)
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome(index, reason=reason, details=traceback.format_exc())


def pack(function: Callable[[T], R], task: T) -> bytes:
    """A call for another process. Pickled here, because Ray would hand over arrays that cannot be written to."""
    return pickle.dumps((function, task, current_naming()))


def call_packed(packed: bytes) -> Any:
    """What `pack` put in, called; only for bytes of our own parent process."""
    function, task, naming = pickle.loads(packed)
    with options_named(naming), notes_on_stderr():
        return function(task)


def in_worker() -> bool:
    """Whether this process works for another, which shows the progress."""
    return multiprocessing.parent_process() is not None or WORKER_VARIABLE in os.environ
