"""Generated bad inputs, through every command: one line that names the file, and nothing else; see `bad_inputs`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.bad_inputs.case import Case
from tests.bad_inputs.cases import ORDINARY, cases, ordinary
from tests.bad_inputs.good import write_good
from tests.bad_inputs.supervisor import Supervisor
from tests.bad_inputs.verdict import faults

NAMES = ordinary()


@pytest.fixture(scope="module")
def supervisor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Supervisor]:
    """The good input, and a process that runs the cases."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "good").mkdir()
    write_good(folder / "good")
    with Supervisor(folder / "good", folder / "cases") as running:
        yield running


def check(supervisor: Supervisor, case: Case) -> None:
    answer = supervisor.run(case)
    assert not faults(case, answer), f"python tests/bad_inputs {case.name}\n{answer.err[-3000:]}"


@pytest.mark.parametrize("name", NAMES)
def test_some(supervisor: Supervisor, name: str) -> None:
    check(supervisor, cases()[name])


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in cases() if name not in NAMES])
def test_all_others(supervisor: Supervisor, name: str) -> None:
    check(supervisor, cases()[name])


def test_there_are_enough_of_every_command() -> None:
    commands = {case.argv[0] for case in cases().values() if case.argv}
    wanted = {
        "simulate",
        "dress",
        "view",
        "train",
        "predict",
        "fuse",
        "evaluate",
        "render",
        "inspect",
        "export",
        "import",
        "migrate",
    }
    assert wanted <= commands
    assert wanted <= {cases()[name].argv[0] for name in NAMES if cases()[name].argv}
    assert len(cases()) >= 500
    assert len(NAMES) == ORDINARY
