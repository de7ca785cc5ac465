"""Options in messages. A parameter of Python, a flag of a command line and a key of a configuration are one thing, and
each reader is told of it in the words in which he gives it.

A message is put together where the mistake is found, and joined, wrapped and sent between processes before anybody
reads it. So the words are chosen when it is put together, as for translations, and a program says once which it wants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Option:
    """A choice of the user's that a message names: `f"{source}: no seam; leave out {Option('weld')}"`.

    Args:
        name: of the parameter.
        value: that it should have, or has; None names the option alone, True turns it on.
    """

    name: str
    value: object = None

    def __str__(self) -> str:
        return _NAMINGS[-1](self)


#: What readers call an option; a function of a module, so that processes can send it.
Naming = Callable[[Option], str]


def as_parameter(option: Option) -> str:
    """As Python has it: weld, weld=True, unit='cm'."""
    value = str(option.value) if isinstance(option.value, Path) else option.value
    return option.name if value is None else f"{option.name}={value!r}"


_NAMINGS: list[Naming] = [as_parameter]


@contextmanager
def options_named(naming: Naming) -> Iterator[None]:
    """Messages that are put together in here, in any thread, call options so."""
    _NAMINGS.append(naming)
    try:
        yield
    finally:
        _NAMINGS.pop()


def current_naming() -> Naming:
    """What calls options by name at present, for another process to do the same."""
    return _NAMINGS[-1]
