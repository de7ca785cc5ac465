"""The README's commands: every line parses, every file it names is there, and the quick ones run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from imgtransfer.cli.main import COMMANDS, build_parser, main

PROJECT = Path(__file__).parents[1]
README = (PROJECT / "README.md").read_text()
BLOCKS = re.findall(r"^```(?:bash|sh|shell|console)\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
NAMES = {name.rstrip("_") for name in COMMANDS}  # the module of `import` is import_
IN_PROJECT = {
    "configs",
    "constraints.txt",
    "docs",
    "scripts",
    "tests",
}  # not what the commands themselves write


def command_lines() -> list[list[str]]:
    """Every command in a block of shell, as words: without comments and prompts, continued lines joined."""
    text = "".join(BLOCKS).replace("\\\n", " ")
    lines = [shlex.split(line.removeprefix("$ "), comments=True) for line in text.splitlines()]
    return [words for words in lines if words]


OURS = [words[1:] for words in command_lines() if Path(words[0]).name == "imgtransfer"]


def test_the_readme_shows_every_command() -> None:
    assert len(OURS) >= 8
    assert {words[0] for words in OURS} >= NAMES


@pytest.mark.parametrize("words", OURS, ids=" ".join)
def test_a_line_parses(words: list[str]) -> None:
    args = build_parser().parse_args(words)
    assert callable(args.run)


@pytest.mark.parametrize("words", command_lines(), ids=" ".join)
def test_the_files_that_a_line_names_are_there(words: list[str]) -> None:
    """Words that start with a folder of the project must name something in it; glob patterns something that fits."""
    for word in words:
        path = word.partition("=")[2] or word  # --set data.source=configs/...
        if Path(path).parts[:1] and Path(path).parts[0] in IN_PROJECT and "://" not in path:
            assert list(PROJECT.glob(path)), f"{path} is not there"


def test_links_and_pictures_are_there() -> None:
    targets = [target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", README)]
    local = [
        target for target in targets if target and "://" not in target and not target.startswith("mailto:")
    ]
    assert local
    for target in local:
        assert (PROJECT / target).exists(), f"{target} is not there"


def test_the_quick_lines_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(PROJECT)
    quick = [
        words
        for words in OURS
        if words[0] == "doctor"
        or (
            words[0] == "inspect" and (PROJECT / words[1]).exists() and "--html" not in words
        )  # writes a file
    ]
    assert {words[0] for words in quick} == {"doctor", "inspect"}
    for words in quick:
        assert main(words) == 0
        assert capsys.readouterr().out.count("\n") > 3


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_command_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([name, "--help"])
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: imgtransfer {name}")
    options = text[text.index("options:") :].split("\n  -")[1:]
    assert options
    # an argument without an explanation would show as a line of its name alone
    assert all(len(option.split()) > 2 for option in options)


PYTHON = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_the_readme_has_python() -> None:
    assert PYTHON


@pytest.mark.parametrize("block", PYTHON)
def test_a_python_block_runs(
    block: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It prints what its comments promise."""
    monkeypatch.chdir(PROJECT)
    exec(compile(block, "README.md", "exec"), {})
    promised = re.findall(r"^print\(.*?\)  # (\([\d, ]+\))", block, re.MULTILINE)
    assert promised
    assert capsys.readouterr().out.split("\n")[: len(promised)] == promised
