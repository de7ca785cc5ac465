"""Clips on a Ray cluster of two nodes on this machine, one of which is killed in the middle."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.store import DataSet
from imgtransfer.running import Cluster, run_tasks
from render import InputError
from tests.helpers.paths import ROOT
from tests.helpers.running_examples import Task, square

pytestmark = pytest.mark.long
MEMORY = {"object_store_memory": 80 * 2**20}


def _within(seconds: float, done: Callable[[], bool]) -> bool:
    """Wait until `done`, but not longer."""
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.1)
    return done()


@pytest.fixture
def two_nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, Any]]:
    """A cluster of a head node and a second one, a core each, and that second node."""
    from ray.cluster_utils import Cluster as Machines  # noqa: PLC0415

    paths = [str(ROOT)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))  # for the workers
    machines = Machines(initialize_head=True, head_node_args={"num_cpus": 1, **MEMORY})
    try:
        yield machines, machines.add_node(num_cpus=1, **MEMORY)
    finally:
        machines.shutdown()


def test_tasks_of_a_killed_node_are_done_by_the_other(two_nodes: tuple[Any, Any], tmp_path: Path) -> None:
    machines, second = two_nodes
    tasks = [Task(number, tmp_path, seconds=1.0) for number in range(12)]

    def kill() -> None:
        if _within(60, lambda: len(list(tmp_path.glob("*-0-*"))) >= 6):
            machines.remove_node(second, allow_graceful=False)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    found = run_tasks(
        square, tasks, executor=Cluster(machines.address), name=lambda task: task.name, progress=False
    )
    killer.join()
    assert found.failures == {}
    assert found.values == {f"task {number}": number**2 for number in range(12)}
    starts = Counter(int(file.name.split("-")[0]) for file in tmp_path.glob("*-*-*"))
    assert sum(starts.values()) > 12  # what died with the node was begun again


CONFIG = {
    "garment": {"edge_length": 0.05},
    "solver": {"iterations": 2, "settle_seconds": 0.1, "warm_up_seconds": 0.1},
    "clips": [{"motion": "random", "seed": 1, "last_seed": 12, "seconds": 1.0}],
}


def test_simulation_loses_and_repeats_no_clip_when_a_node_is_killed(
    two_nodes: tuple[Any, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machines, second = two_nodes
    (tmp_path / "set.yaml").write_text(json.dumps(CONFIG))  # JSON is YAML
    out = tmp_path / "set.zarr"
    written: dict[str, int] = {}  # when the clips that stood at the kill had been written

    def kill() -> None:
        if _within(120, lambda: len(list(out.glob("*/*/zarr.json"))) >= 4):
            machines.remove_node(second, allow_graceful=False)
            standing = DataSet.open(out).names()
            written.update({name: (out / name / "zarr.json").stat().st_mtime_ns for name in standing})

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    command = ["simulate", str(tmp_path / "set.yaml"), "--out", str(out), "--ray", machines.address]
    assert main(command) == 0
    killer.join()
    data = DataSet.open(out)
    assert data.names() == sorted(f"tshirt/random_s{seed}" for seed in range(1, 13))
    assert 4 <= len(written) < 12
    lines = capsys.readouterr().out.splitlines()
    made = Counter(line.split()[0] for line in lines if " frames, " in line or line.endswith(": stands"))
    assert set(made.values()) == {1}  # one outcome for each clip
    for name, when in written.items():
        assert (out / name / "zarr.json").stat().st_mtime_ns == when, f"{name} was written twice"
    for name in data.names():
        assert data.read(name).n_frames == 30
    assert main(command) == 0  # a second run finds nothing to do
    assert "12 of 12 clips stand, 0 rejected" in capsys.readouterr().out


def test_no_cluster_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^ray 127.0.0.1:9: no Ray cluster answers there"):
        run_tasks(
            square,
            [Task(1, tmp_path)],
            executor=Cluster("127.0.0.1:9"),
            name=lambda task: task.name,
            progress=False,
        )
