"""`imgtransfer completion`: what a shell needs to complete the command with the Tab key."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

SHELLS = ("bash", "zsh")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "completion",
        help="print what bash or zsh needs to complete commands, options and files",
        description="Prints a script with which the Tab key completes commands, options, their values and files. For "
        "bash it goes where the first example writes it (with the package bash-completion), or `source <(imgtransfer "
        "completion bash)` into ~/.bashrc; for zsh into a file _imgtransfer in a folder of $fpath. New shells have it.",
        examples=(
            "imgtransfer completion bash > ~/.local/share/bash-completion/completions/imgtransfer",
            "imgtransfer completion zsh > ~/.zfunc/_imgtransfer",
        ),
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")
    return parser


def run(args: argparse.Namespace) -> None:
    """Print the script."""
    print(completion_of(args.shell), end="")


def completion_of(shell: str) -> str:
    """The script that completes `imgtransfer` in one of `SHELLS`."""
    import shtab  # noqa: PLC0415

    from imgtransfer.cli.main import build_parser  # noqa: PLC0415

    parser = build_parser()
    for action in _actions(parser):
        if isinstance(action, argparse._SubParsersAction):
            # zsh shows the description beside the name, where a line has room
            for one in action._choices_actions:
                action.choices[one.dest].description = one.help
        if action.choices is None and _is_file(action):
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # where shtab looks for it
    return shtab.complete(parser, shell).rstrip() + "\n"


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument of a parser and of those below it."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                yield from _actions(one)


def _is_file(action: argparse.Action) -> bool:
    """Whether a value is a file or folder: what is no option always is, here."""
    return action.type is Path or not action.option_strings
