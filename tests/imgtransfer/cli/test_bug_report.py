"""The text for a bug report: what it tells of the machine, and what it never tells of the user."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from imgtransfer.cli import bug_report
from imgtransfer.cli.machine import Part
from imgtransfer.cli.main import main


def test_the_report_has_the_machine_the_extras_and_the_packages(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("SECRET_TOKEN", "hunter2")
    assert main(["doctor", "--report"]) == 0
    text = capsys.readouterr().out
    assert re.findall(r"^### (.*)$", text, re.MULTILINE) == [
        "Machine", "What does not work", "Extras", "Packages",
    ]  # fmt: skip
    rows = dict(re.findall(r"^\| (\S+) \| (.*) \|$", text, re.MULTILINE))
    assert rows.keys() >= {
        "imgtransfer",
        "system",
        "memory",
        "cores",
        "GL",
        "torch",
        "vectors",
        "bfloat16",
        "view",
    }
    assert "OMP_NUM_THREADS=1" in rows["variables"]
    assert re.search(r"^torch==\d", text, re.MULTILINE)
    assert re.search(r"^numpy==\d", text, re.MULTILINE)
    assert "hunter2" not in text
    assert "SECRET" not in text
    assert "Nothing that `imgtransfer doctor` looks at." in text
    assert text.count("```") == 2


def test_nobody_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    home = tmp_path / "jane.doe"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("LOGNAME", "jane.doe")
    problem = (
        f"Warp fails in {home}/work/lib|x.so\nand in /scratch/jane.doe/tmp, not in {home}-two or /jane.doe2"
    )
    text = bug_report.bug_report([Part((("GL", f"at {home}"),), problem)])
    assert "| GL | at ~ |" in text
    assert (
        f"- Warp fails in ~/work/lib\\|x.so and in /scratch/USER/tmp, not in {home}-two or /jane.doe2\n"
        in text
    )


def test_a_home_of_everything_hides_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/")
    monkeypatch.setenv("LOGNAME", "nobody")
    assert bug_report.scrubbed("/usr/lib in /home/nobody/x") == "/usr/lib in /home/USER/x"


def test_a_missing_package_is_named_at_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = ["numpy>=1", "absent-one>=2; extra == 'far'", 'numpy; sys_platform != "x" and extra == "near"']
    monkeypatch.setattr(bug_report, "_declared", lambda: declared)
    text = bug_report.bug_report([])
    assert "| far | missing: absent-one |" in text
    assert "| near | present |" in text
