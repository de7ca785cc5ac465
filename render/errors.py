"""The one exception for input that the user can mend, and text from files made fit to be shown."""

from __future__ import annotations

import re

# Control codes (a terminal acts on them), line ends of every kind, and marks that turn the direction of writing.
_UNSHOWN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]+")
_LONGEST, _END = 1400, 500  # characters, and how many of them are of the end, where the reason often stands


def one_line(text: object) -> str:
    """Text that may come from anybody's file, for the terminal: in one line, no control codes, not endless."""
    line = _UNSHOWN.sub(" ", str(text)).strip()
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - _END]} ... {line[-_END:]}"


class InputError(ValueError):
    """Input that cannot be used: says the file or argument, what was wanted, what was found, what to do.

    The command line prints the message as one line and exits with status 2; library callers may catch it.
    """

    def __init__(self, message: object) -> None:
        super().__init__(one_line(message))


def said_by(error: BaseException, longest: int = 200) -> str:
    """What an error of another package says, on one line, cut where it would run on."""
    text = one_line(error) or "no reason given"
    return text if len(text) <= longest else text[:longest] + " ..."
