from __future__ import annotations

import pickle

from render import InputError
from render.errors import one_line


def test_a_message_is_one_line_without_what_a_terminal_acts_on() -> None:
    assert str(InputError("a\nb\x1b[2J c\x07\x9b1m\u202edlrow")) == "a b [2J c 1m dlrow"
    assert one_line("ä, 織 and é") == "ä, 織 and é"
    assert one_line("x" * 5000 + "y" * 500) == "x" * 900 + " ... " + "y" * 500


def test_it_comes_from_another_process_as_it_was() -> None:
    assert str(pickle.loads(pickle.dumps(InputError("a\nb")))) == "a b"
