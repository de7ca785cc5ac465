"""What programs say of the library: options as their reader gives them, notes as lines on stderr."""

from __future__ import annotations

import ast
import logging
import pickle
import re
from pathlib import Path

import pytest

from imgtransfer.importers.checks.axes import Axes
from imgtransfer.running.exit import exit_status
from imgtransfer.running.messages import as_flag, notes_on_stderr
from imgtransfer.running.task import call_packed, pack
from render import InputError, Option
from render.options import as_parameter, current_naming, options_named
from tests.helpers.paths import ROOT


@pytest.mark.parametrize(
    ("option", "parameter", "flag"),
    [
        (Option("weld"), "weld", "--weld"),
        (Option("weld", True), "weld=True", "--weld"),
        (Option("garment_unit", "cm"), "garment_unit='cm'", "--garment-unit=cm"),
        (Option("up", "-y"), "up='-y'", "--up=-y"),
        (Option("scale", 0.01), "scale=0.01", "--scale=0.01"),
        (Option("smpl", Path("a/b")), "smpl='a/b'", "--smpl=a/b"),
        (Option("clips"), "clips", "--clip"),
        (Option("changes"), "changes", "--set"),
    ],
)
def test_an_option_in_python_and_on_a_command_line(option: Option, parameter: str, flag: str) -> None:
    assert str(option) == parameter
    with options_named(as_flag):
        assert str(option) == flag
    assert str(option) == parameter


def test_the_naming_ends_with_its_block_even_by_an_error() -> None:
    with pytest.raises(InputError, match=r"^--up=q: one of x"), options_named(as_flag):
        Axes(up="q")
    with pytest.raises(InputError, match=r"^up='q': one of x"):
        Axes(up="q")
    assert current_naming() is as_parameter


def axes_of(up: str) -> Axes:
    return Axes(up=up)


def test_a_task_in_another_process_names_options_as_its_parent() -> None:
    with options_named(as_flag):
        packed = pack(axes_of, "q")
    assert pickle.loads(packed)[2] is as_flag
    with pytest.raises(InputError, match=r"^--up=q"):
        call_packed(packed)


def test_what_the_library_logs_is_a_line_on_stderr_while_a_program_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    logger = logging.getLogger("imgtransfer.somewhere")
    with notes_on_stderr():
        logger.info("first %s", Option("weld"))
        logger.warning("note: second")
        logger.debug("not this")
    assert capsys.readouterr().err == "first weld\nnote: second\n"
    logger.info("not this either")
    assert capsys.readouterr().err == ""
    assert logging.getLogger("imgtransfer").handlers == []
    assert logging.getLogger("imgtransfer").level == logging.NOTSET


def test_a_program_says_options_as_flags(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status(lambda: Axes(up="q"), program="test", stopped="stopped") == 2
    assert capsys.readouterr().err.startswith("test: error: --up=q: one of x")


def test_library_code_speaks_no_command_line() -> None:
    """Flags stand in the programs (cli, the demo's), in `running.messages`, in docstrings, and in a model's card."""
    programs = {ROOT / "imgtransfer/running/messages.py", ROOT / "imgtransfer/training/hub_card.py"}
    programs |= set((ROOT / "imgtransfer/demo").glob("*.py"))
    programs |= set((ROOT / "imgtransfer/cli").glob("*.py"))
    flags = []
    for layer in ("render", "fusion", "imgtransfer"):
        for file in set((ROOT / layer).rglob("*.py")) - programs:
            tree = ast.parse(file.read_text(encoding="utf-8"))
            docstrings = {
                id(node.body[0].value)
                for node in ast.walk(tree)
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
                and node.body
                and isinstance(node.body[0], ast.Expr)
            }
            for node in ast.walk(tree):
                text = node.value if isinstance(node, ast.Constant) and id(node) not in docstrings else None
                if isinstance(text, str) and re.search(r"(^|[\s,;]|(?<!\bvar)\()--[a-z]", text):
                    flags.append(f"{file.relative_to(ROOT)}:{node.lineno}: {text}")
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                    flags.append(f"{file.relative_to(ROOT)}:{node.lineno}: print")
    exits = "imgtransfer/running/exit.py"  # prints the line of a mistake
    assert [flag for flag in flags if not flag.startswith(exits)] == []
