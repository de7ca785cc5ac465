"""Commands let their threads sleep while they wait, before PyTorch is loaded, unless the user has chosen."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from imgtransfer.running.waiting import passive_waiting, wait_passively, waiting_in_words
from tests.helpers.paths import ROOT

NAMES = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME", "KMP_LIBRARY")


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.setenv(name, "")  # so that it is undone even where it was absent
        monkeypatch.delenv(name)


def test_threads_sleep_where_nobody_has_chosen() -> None:
    assert waiting_in_words() == "no OMP_WAIT_POLICY"
    wait_passively()
    assert os.environ["OMP_WAIT_POLICY"] == "PASSIVE"
    assert waiting_in_words() == "OMP_WAIT_POLICY=PASSIVE"


@pytest.mark.parametrize("name", NAMES)
def test_the_users_choice_stands(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, "7")
    assert passive_waiting() == {}
    wait_passively()
    assert {key: os.environ[key] for key in NAMES if key in os.environ} == {name: "7"}


COMMAND = """
import os, sys, {module} as command
sys.argv[1:] = ["--help"]
try:
    command.main()
except SystemExit:
    assert "torch" not in sys.modules
    print(os.environ["OMP_WAIT_POLICY"])
"""


def run(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )


def test_pytorchs_openmp_is_told_by_the_command() -> None:
    """OpenMP itself says what it has understood (OMP_DISPLAY_ENV) when PyTorch loads it."""
    done = run(COMMAND.format(module="imgtransfer.cli.main") + "import torch", OMP_DISPLAY_ENV="true")
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in done.stderr


def test_the_demo_tells_it_before_pytorch_is_loaded() -> None:
    assert run(COMMAND.format(module="imgtransfer.demo.__main__")).stdout.splitlines()[-1] == "PASSIVE"


def test_importing_the_library_changes_no_environment() -> None:
    modules = "imgtransfer.cli.main, imgtransfer.running, imgtransfer.demo.__main__"
    program = f"import os; before = dict(os.environ); import {modules}; print(before == os.environ)"
    assert run(program).stdout.split() == ["True"]
