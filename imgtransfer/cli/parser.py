"""The parser of every command: help that ends with examples, and one line about what cannot be parsed."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from difflib import get_close_matches
from shlex import quote
from typing import Any


class Parser(argparse.ArgumentParser):
    """argparse's, in which an unknown argument is an error of its own command, and options are written out.

    Abbreviated options are refused: a script that has one would break, or do something else, when an option is added.

    Args:
        examples: command lines that the help ends with.
    """

    def __init__(self, *args: Any, examples: Sequence[str] = (), **kwargs: Any) -> None:
        super().__init__(*args, **{**kwargs, "allow_abbrev": False, "formatter_class": _Formatter})
        self.examples = tuple(examples)
        if examples:
            self.epilog = "\n".join(("examples:", *(f"  {line}" for line in examples)))

    def parse_known_args(  # type: ignore[override]  # argparse's is overloaded by the type of the namespace
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse's, but whatever is not known ends the program."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(self._about(unknown[0]))
        return found, unknown

    def error(self, message: str) -> Any:
        """Print one line and exit with status 2."""
        if message.endswith("expected one argument"):
            message += "; a value that begins with a minus needs an equals sign, such as --facing=-y"
        self.exit(2, f"{self.prog}: error: {message} (`{self.prog} --help` shows what there is)\n")

    def _about(self, unknown: str) -> str:
        """What to say of an argument that nothing takes."""
        options = [option for action in self._actions for option in action.option_strings]
        if unknown.startswith("-"):
            option = unknown.partition("=")[0]
            close = get_close_matches(option, options, n=1)
            return f"there is no {option}{f', did you mean {close[0]}?' if close else ''}"
        if "--clip" in options:
            return f"{unknown}: one argument too many; clips are chosen by name with --clip {quote(unknown)}"
        return f"{unknown}: one argument too many"


class _Formatter(argparse.HelpFormatter):
    """Fills paragraphs, but leaves lines as they are where a paragraph has several."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        parts = text.split("\n\n")
        return "\n\n".join(part if "\n" in part else fill(part, width, indent) for part in parts)
