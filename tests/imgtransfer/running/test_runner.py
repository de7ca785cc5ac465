"""Tasks are done whatever happens to the processes that do them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from imgtransfer.running import Executor, Pool, Serial, executor_for, run_tasks
from imgtransfer.running.cluster import Cluster
from imgtransfer.running.exit import exit_status
from imgtransfer.running.task import attempt
from render import InputError
from tests.helpers import running_examples
from tests.helpers.paths import ROOT
from tests.helpers.running_examples import Task, square


def run(tasks: list[Task], executor: Executor, **options: object) -> tuple[dict[str, int], dict[str, str]]:
    found = run_tasks(square, tasks, executor=executor, name=lambda task: task.name, progress=False)
    return found.values, found.failures


@pytest.mark.parametrize("executor", [Serial(), Pool(2)], ids=["serial", "pool"])
def test_results_come_by_name_in_the_order_of_the_tasks(tmp_path: Path, executor: Executor) -> None:
    tasks = [Task(3, tmp_path, seconds=0.3), Task(1, tmp_path), Task(2, tmp_path)]
    values, failures = run(tasks, executor)
    assert (list(values.items()), failures) == ([("task 3", 9), ("task 1", 1), ("task 2", 4)], {})


@pytest.mark.parametrize("executor", [Serial(), Pool(2)], ids=["serial", "pool"])
def test_failures_do_not_end_the_others(
    tmp_path: Path, executor: Executor, capsys: pytest.CaptureFixture[str]
) -> None:
    tasks = [Task(1, tmp_path, fault="input"), Task(2, tmp_path, fault="bug"), Task(3, tmp_path)]
    values, failures = run(tasks, executor)
    assert values == {"task 3": 9}
    assert failures == {"task 1": "1 is no good", "task 2": "ZeroDivisionError: a bug"}
    err = capsys.readouterr().err
    assert err.count("Traceback") == 1  # of the bug, not of the user's mistake
    assert "running_examples.py" in err


def test_a_killed_process_takes_no_task_with_it(tmp_path: Path) -> None:
    tasks = [Task(1, tmp_path, deaths=2), *(Task(number, tmp_path) for number in range(2, 6))]
    values, failures = run(tasks, Pool(2, retries=2))
    assert (values, failures) == ({f"task {n}": n * n for n in range(1, 6)}, {})
    starts = [len(list(tmp_path.glob(f"{number}-*"))) for number in range(1, 6)]
    assert starts == [3, 1, 1, 1, 1]  # nobody else's task was done again


def test_a_task_that_always_kills_its_process_fails_at_last(tmp_path: Path) -> None:
    values, failures = run([Task(1, tmp_path, deaths=99), Task(2, tmp_path)], Pool(2, retries=1))
    assert values == {"task 2": 4}
    assert failures == {"task 1": "its process died 2 times, the last time with exit status -9"}
    assert len(list(tmp_path.glob("1-*"))) == 2


def test_cores_are_shared_out(tmp_path: Path) -> None:
    tasks = [Task(number, tmp_path) for number in range(2)]
    before = os.environ.get("OMP_NUM_THREADS")
    cores = len(os.sched_getaffinity(0))
    for pool, wanted in ((Pool(2), max(1, cores // 2)), (Pool(2, threads=1), 1)):
        found = run_tasks(
            running_examples.threads, tasks, executor=pool, name=lambda task: task.name, progress=False
        )
        assert set(found.values.values()) == {f"{wanted} PASSIVE"}
    assert os.environ.get("OMP_NUM_THREADS") == before


def test_a_result_that_cannot_be_sent_is_a_failure(tmp_path: Path) -> None:
    found = run_tasks(
        running_examples.unpicklable,
        [Task(1, tmp_path)],
        executor=Pool(1),
        name=lambda task: task.name,
        progress=False,
    )
    assert "its result cannot be sent" in found.failures["task 1"]


def test_no_tasks_are_no_work(tmp_path: Path) -> None:
    assert run([], Pool(2)) == ({}, {})


PARENT = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a test in the background inherits that it is ignored
sys.path[:0] = {paths!r}
from pathlib import Path
from tests.helpers.running_examples import Task, square_into_file
from imgtransfer.running.exit import exit_status
from imgtransfer.running import Pool, run_tasks
if __name__ == "__main__":
    tasks = [Task(number, Path({folder!r}), seconds=60) for number in range(4)]
    work = lambda: run_tasks(square_into_file, tasks, executor=Pool(2), name=lambda task: task.name)
    sys.exit(exit_status(work, program="test", stopped="stopped"))
"""


@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)],
    ids=["Ctrl-C", "SIGTERM", "kill -9"],
)
def test_nothing_goes_on_when_the_parent_ends(tmp_path: Path, number: int, status: int) -> None:
    program = tmp_path / "parent.py"
    paths = [str(ROOT)]
    program.write_text(PARENT.format(paths=paths, folder=str(tmp_path)))
    parent = subprocess.Popen([sys.executable, str(program)], start_new_session=True, stderr=subprocess.PIPE)
    _until(lambda: len(list(tmp_path.glob("*-0-*"))) == 2)
    workers = [int(file.name.split("-")[-1]) for file in tmp_path.glob("*-0-*")]
    if number == signal.SIGINT:
        os.killpg(parent.pid, number)  # as a terminal does: to all of the group
    else:
        parent.send_signal(number)
    err = parent.communicate(timeout=20)[1].decode()
    assert parent.returncode == status
    if number != signal.SIGKILL:
        assert err.splitlines()[-1] == "test: stopped"
        assert "Traceback" not in err
        assert not list(tmp_path.glob(".*"))  # half-written results
    _until(lambda: not any(_alive(worker) for worker in workers))
    assert len(list(tmp_path.glob("*-*-*"))) == 2  # no other task was begun


def _until(done: object, seconds: float = 30) -> None:
    end = time.monotonic() + seconds
    while not done():  # type: ignore[operator]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "not enough memory"),
        (MemoryError("Unable to allocate 112. GiB"), "not enough memory (Unable to allocate 112. GiB)"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), "not enough memory (Default"),
    ],
)
def test_too_little_memory_is_one_line(
    capsys: pytest.CaptureFixture[str], error: Exception, said: str
) -> None:
    def work(_: object = None) -> None:
        raise error

    assert exit_status(work, program="test", stopped="stopped") == 2
    assert capsys.readouterr().err.startswith(f"test: error: {said}")
    assert str(attempt(work, None, 0).reason).startswith(said)
    with pytest.raises(RuntimeError, match="something else"):
        exit_status(lambda: (_ for _ in ()).throw(RuntimeError("something else")), program="test", stopped="")


def test_the_second_sigterm_ends_the_process_at_once(tmp_path: Path) -> None:
    program = """if True:
        import os, signal, sys
        from imgtransfer.running.exit import exit_status
        def work():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            finally:
                print("cleaning up", flush=True)
                os.kill(os.getpid(), signal.SIGTERM)
        sys.exit(exit_status(work, program="test", stopped="stopped"))
    """
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGTERM, "cleaning up\n", "")


def test_check_lists_the_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tasks = [Task(1, tmp_path, fault="input"), Task(2, tmp_path), Task(3, tmp_path, fault="input")]
    found = run_tasks(square, tasks, executor=Serial(), name=lambda task: task.name, progress=False)
    with pytest.raises(InputError, match="2 of 3 clips failed, listed above"):
        found.check()
    assert capsys.readouterr().out == ("failed, 2 of 3:\n  task 1: 1 is no good\n  task 3: 3 is no good\n")
    alone = run_tasks(square, tasks[:1], executor=Serial(), name=lambda task: task.name, progress=False)
    with pytest.raises(InputError, match=r"^1 is no good$"):
        alone.check()


def test_the_executor_follows_the_options() -> None:
    assert executor_for() == Serial()
    assert executor_for(workers=3) == Pool(3)
    assert executor_for(ray="auto") == Cluster("auto")
    with pytest.raises(InputError, match="workers 0: a whole number"):
        executor_for(workers=0)
    with pytest.raises(InputError, match="give one of them"):
        executor_for(workers=2, ray="auto")
