"""Commands in the README, the pages and the help: every line parses, files it names are there, quick ones run."""

from __future__ import annotations

import re
import shlex
from itertools import takewhile
from pathlib import Path

import pytest

from imgtransfer.cli.main import COMMANDS, build_parser, main
from imgtransfer.cli.parser import Parser
from tests.helpers.paths import ROOT

README = (ROOT / "README.md").read_text()
NAMES = {name.rstrip("_") for name in COMMANDS}  # the module of `import` is import_
IN_PROJECT = {
    "configs",
    "constraints.txt",
    "docs",
    "scripts",
    "tests",
}  # not what the commands themselves write


SHELL = {"|", ">", "&&"}  # where a command's own words end


def commands(text: str) -> list[list[str]]:
    """Every command in lines of shell, as words: without comments and prompts, continued lines joined."""
    lines = [shlex.split(line.strip().removeprefix("$ "), comments=True) for line in text.splitlines()]
    return [list(takewhile(lambda word: word not in SHELL, words)) for words in lines if words]


FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(text: str) -> str:
    """The shell of a page: fences of shell, what is typed in sessions, and our command where it begins a line that is
    indented, or stands in a fence without a language.
    """
    text = text.replace("\\\n", " ")
    fences = FENCE.findall(text)
    shell = [body for language, body in fences if language in ("bash", "sh", "shell")]
    sessions = "".join(body for language, body in fences if language == "console")  # with what is printed
    plain = "".join(body for language, body in fences if not language)
    typed = re.findall(r"^\$ .*$", sessions, re.MULTILINE)
    typed += re.findall(r"^ *(?:\$ )?((?:\S*/)?imgtransfer .*)$", plain, re.MULTILINE)
    typed += re.findall(r"^ {4,}((?:\S*/)?imgtransfer .*)$", FENCE.sub("", text), re.MULTILINE)
    return "\n".join([*shell, *typed])


def command_lines() -> list[list[str]]:
    """The README's commands, as words."""
    return commands(blocks(README))


def ours(lines: list[list[str]]) -> list[list[str]]:
    return [words[1:] for words in lines if Path(words[0]).name == "imgtransfer"]


OURS = ours(command_lines())
PAGES = {
    page.relative_to(ROOT): page for folder in ("docs", "configs") for page in (ROOT / folder).rglob("*.md")
}
OF_PAGES = [
    pytest.param(words, id=f"{page}: {' '.join(words)}")
    for page, path in sorted(PAGES.items())
    for words in ours(commands(blocks(path.read_text())))
]


def examples() -> dict[str, tuple[str, ...]]:
    """The examples that each command's help ends with, and those of the whole."""
    parser = build_parser()
    assert isinstance(parser, Parser)
    (commands,) = (action for action in parser._actions if isinstance(action.choices, dict))
    return {"": parser.examples} | {name: one.examples for name, one in commands.choices.items()}


def test_every_help_ends_with_two_examples() -> None:
    assert set(examples()) == {"", *NAMES}
    for name, lines in examples().items():
        assert len(lines) == 2, name
        assert all(line.startswith(f"imgtransfer {name}") for line in lines)


@pytest.mark.parametrize("line", [line for lines in examples().values() for line in lines])
def test_an_example_parses_and_names_what_is_there(line: str) -> None:
    ((_, *words),) = commands(line)
    assert callable(build_parser().parse_args(words).run)
    test_the_files_that_a_line_names_are_there(words)


def test_pages_show_commands() -> None:
    assert len(OF_PAGES) > 10


@pytest.mark.parametrize("words", OF_PAGES)
def test_a_line_of_a_page_parses(words: list[str]) -> None:
    assert callable(build_parser().parse_args(words).run)


@pytest.mark.parametrize("words", OF_PAGES)
def test_the_files_that_a_line_of_a_page_names_are_there(words: list[str]) -> None:
    test_the_files_that_a_line_names_are_there(words)


@pytest.mark.parametrize(
    ("page", "lines"),
    [
        ("```bash\nimgtransfer doctor   # what works\n```", ["doctor"]),
        ("```bash\nimgtransfer inspect \\\n    a.zarr\n```", ["inspect a.zarr"]),
        ("```\nimgtransfer doctor\n.venv/bin/imgtransfer inspect a.zarr\nall well\n```", ["doctor", "inspect a.zarr"]),
        ("```console\n$ imgtransfer doctor\nimgtransfer is well\n```", ["doctor"]),
        ("```text\nimgtransfer is well\n```", []),
        ("as in\n\n    imgtransfer doctor\n      imgtransfer inspect a.zarr\n", ["doctor", "inspect a.zarr"]),
        ("```yaml\na: 1\n```\nimgtransfer is well\n```\nimgtransfer doctor\n```", ["doctor"]),
    ],
)  # fmt: skip
def test_our_command_is_seen_wherever_a_page_may_have_it(page: str, lines: list[str]) -> None:
    assert [" ".join(words) for words in ours(commands(blocks(page)))] == lines


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
        path = re.sub(r"\$\w+", "*", word.partition("=")[2] or word)  # --set data.source=configs/...
        if Path(path).parts[:1] and Path(path).parts[0] in IN_PROJECT and "://" not in path:
            assert list(ROOT.glob(path)), f"{path} is not there"


def test_links_and_pictures_are_there() -> None:
    targets = [target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", README)]
    local = [
        target for target in targets if target and "://" not in target and not target.startswith("mailto:")
    ]
    assert local
    for target in local:
        assert (ROOT / target).exists(), f"{target} is not there"


def test_the_quick_lines_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    quick = [
        words
        for words in OURS
        if words[0] == "doctor"
        or (words[0] == "inspect" and (ROOT / words[1]).exists() and "--html" not in words)  # writes a file
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
    monkeypatch.chdir(ROOT)
    exec(compile(block, "README.md", "exec"), {})
    promised = re.findall(r"^print\(.*?\)  # (\([\d, ]+\))", block, re.MULTILINE)
    assert promised
    assert capsys.readouterr().out.split("\n")[: len(promised)] == promised
