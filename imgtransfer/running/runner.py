"""Tasks with a progress bar, their results by name, and a list of what failed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Generic, TypeVar

from tqdm import tqdm

from imgtransfer.running.cluster import Cluster
from imgtransfer.running.pool import Pool
from imgtransfer.running.task import Executor, Serial
from render import InputError, Option

T = TypeVar("T")
R = TypeVar("R")
MOST_WORKERS = 1024  # on one machine


@dataclass(frozen=True)
class Run(Generic[R]):
    """What came of a list of tasks.

    Args:
        values: by the task's name, what the function returned, in the order of the tasks.
        failures: by the task's name, one line that says why there is no value.
    """

    values: dict[str, R]
    failures: dict[str, str]

    def check(self, unit: str = "clip") -> None:
        """List the failures, if any.

        Raises:
            InputError: there are failures: the reason of the only task, or how many failed.
        """
        if not self.failures:
            return
        total = len(self.values) + len(self.failures)
        if total == 1:
            raise InputError(next(iter(self.failures.values())))
        # On stdout, as what `run_tasks` says of each task.
        tqdm.write(f"failed, {len(self.failures)} of {total}:")
        for name, reason in self.failures.items():
            tqdm.write(f"  {name}: {reason}")
        first = next(iter(self.failures.items()))
        raise InputError(
            f"{len(self.failures)} of {total} {unit}s failed, listed above; the same command tries them again; "
            f"the first was {': '.join(first)}"
        )


def executor_for(*, workers: int = 1, ray: str | None = None) -> Executor:
    """Where tasks are done: here, in so many processes, or on a Ray cluster.

    Raises:
        InputError: fewer than one worker, more than any machine has cores, or both.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise InputError(f"{Option('workers')} {workers}: a whole number from 1 to {MOST_WORKERS} is wanted")
    if ray is not None:
        if workers != 1:
            raise InputError(
                f"{Option('workers')} is for this machine, {Option('ray')} for a cluster; give one of them"
            )
        return Cluster(ray)
    return Pool(workers) if workers > 1 else Serial()


def run_tasks(
    function: Callable[[T], R],
    tasks: Sequence[T],
    *,
    executor: Executor,
    name: Callable[[T], str],
    say: Callable[[R], str] = str,
    unit: str = "clip",
    size: Callable[[T], int] | None = None,
    progress: bool = True,
) -> Run[R]:
    """Do all tasks, whatever becomes of some of them.

    Args:
        function: does one task; see `imgtransfer.running`. InputError is a failure that needs no traceback.
        tasks: of the function; their names must differ.
        executor: where they are done.
        name: of a task.
        say: what to print of a result, "" for nothing.
        unit: what the bar counts.
        size: how many of them a task has, such as its frames; 1 each if None.
        progress: whether to print lines and show a bar.

    Raises:
        KeyboardInterrupt: after Ctrl-C, once all processes are stopped.
        InputError: the executor cannot be had.
    """
    values: dict[int, R] = {}
    failures: dict[int, str] = {}
    sizes = [1 if size is None else size(task) for task in tasks]
    with (
        closing(executor.outcomes(function, tasks)) as outcomes,
        tqdm(total=sum(sizes), unit=unit, disable=None if progress else True) as bar,
    ):
        for outcome in outcomes:
            if outcome.reason is not None:
                failures[outcome.index] = outcome.reason
                line = f"{name(tasks[outcome.index])}: failed: {outcome.reason}"
                if outcome.details:
                    bar.write(outcome.details, file=sys.stderr)
            else:
                values[outcome.index] = outcome.value  # type: ignore[assignment]
                line = say(values[outcome.index])
            if progress and line:
                bar.write(line)
            bar.update(sizes[outcome.index])
    return Run(
        {name(tasks[index]): values[index] for index in sorted(values)},
        {name(tasks[index]): failures[index] for index in sorted(failures)},
    )
