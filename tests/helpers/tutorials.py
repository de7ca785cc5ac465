"""Pages whose fenced blocks are run from the first to the last, in one folder, as a reader would.

What runs is what the page shows. Before a fence, comments that no reader sees say where the test departs from it:

    <!-- test: 100000 => 2 -->      in this block the test has the second for the first
    <!-- not run: REASON -->        the block is passed over (its commands are parsed all the same)

A fence of Python, YAML or TOML whose first line is a file's name in a comment (`# mine/method.py`) is that file. A
fence of text is what the block before it prints: each of its lines must be among those printed, in that order, whatever
the numbers; `...` stands for anything.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from imgtransfer.cli.main import main

_FENCE = re.compile(r"((?:^<!--(?:(?!-->).)*-->\n)*)^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"# ([\w./-]+\.(?:py|toml|yaml))\n")
_OPERATORS = {"|", ">", "<", "&", "&&", "||", ";"}  # a line with one of these is the shell's


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    language: str
    text: str  # as it is run
    line: int  # of the page, where its text begins
    not_run: bool

    @property
    def file(self) -> str | None:
        """The file that it is, if it is one."""
        named = _FILE.match(self.text) if self.language in ("python", "toml", "yaml") else None
        return None if named is None else named[1]


def blocks(page: Path) -> Iterator[Block]:
    """Every fenced block of a page, in order, with what the test has in place of something."""
    whole = page.read_text(encoding="utf-8")
    for match in _FENCE.finditer(whole):
        comments, language, text = match.groups()
        line = whole.count("\n", 0, match.start(3)) + 1
        for old, new in re.findall(r"<!-- test: (.*?) => (.*?) -->", comments, re.DOTALL):
            assert old in text, f"{page.name}:{line}: the block has no {old!r} to replace"
            text = text.replace(old, " ".join(new.split()))
        yield Block(language, text, line, "<!-- not run: " in comments)


def run_page(page: Path, folder: Path) -> None:
    """Run a page's blocks; stop at the first line that fails or prints something else.

    Args:
        page: a Markdown file.
        folder: the working folder, which holds what the page's reader has.
    """
    printed = ""
    for block in blocks(page):
        where = f"{page.name}:{block.line}"
        if block.not_run:
            continue
        if block.file is not None:
            (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            printed = _python(block.text, where)
        elif block.language == "bash":
            printed = "".join(_line(line, folder, where) for line in command_lines(block.text))
        elif block.language == "text":
            check_printed(block.text, printed, where)


def command_lines(text: str) -> list[str]:
    """The lines of a block of shell, continued ones joined, without comments and empty ones."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line for line in lines if shlex.split(line, comments=True)]


def _line(line: str, folder: Path, where: str) -> str:
    """Run one line, ours in this process, which has imported everything already, others by bash; what it prints."""
    words = shlex.split(line, comments=True)
    if words[0] == "imgtransfer" and not _OPERATORS & set(words):
        told = io.StringIO()
        with redirect_stdout(told), redirect_stderr(told):
            status = main(words[1:])
        printed = told.getvalue()
    else:
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            cwd=folder,
            env={**os.environ, "PATH": _path()},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        status, printed = done.returncode, done.stdout
    assert status == 0, f"{where}: exit status {status} of\n{line}\n{printed[-4000:]}"
    return printed


def _path() -> str:
    """PATH with the programs of this environment, and of the one whose packages it uses, in front."""
    of_packages = Path(torch.__file__).resolve().parents[4] / "bin"
    return os.pathsep.join([str(Path(sys.executable).parent), str(of_packages), os.environ["PATH"]])


def _python(text: str, where: str) -> str:
    told = io.StringIO()
    space: dict[str, Any] = {"__name__": "__main__"}
    with redirect_stdout(told):
        exec(compile(text, where, "exec"), space)
    return told.getvalue()


def check_printed(wanted: str, printed: str, where: str) -> None:
    """Every line of `wanted` must be among those printed, in that order, whatever the numbers are."""
    lines = iter([_plain(line) for line in printed.splitlines()])
    for line in filter(str.strip, wanted.splitlines()):
        pattern = ".*".join(map(re.escape, _plain(line).split("...")))
        assert any(re.fullmatch(pattern, one) for one in lines), (
            f"{where}: the page says that this is printed:\n{line}\nand printed was\n{printed[-4000:]}"
        )


def _plain(line: str) -> str:
    """A line without what numbers and columns' widths are."""
    return " ".join(re.sub(r"-{3,}", "---", re.sub(r"\d[\d.,]*", "#", line)).split())
