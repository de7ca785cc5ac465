"""Faults of JSON: metadata of Zarr, the lists of what was rejected, reports, logs, headers of safetensors files."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.bad_inputs.case import Fault

DEEP = "[" * 100_000 + "]" * 100_000
DIGITS = "9" * 5000  # Python converts no more than 4,300 by itself
# What a value may be in place of its own; texts stand in the file as they are.
VALUES = {
    "null": "null",
    "text": '"x"',
    "empty-text": '""',
    "list": "[]",
    "dict": '{"a": 1}',
    "true": "true",
    "zero": "0",
    "negative": "-1",
    "large": "1000000000000",
    "digits": DIGITS,
    "fraction": "2.5",
    "nan": "NaN",
    "infinite": "1e999",
    "deep": DEEP,
    "surrogate": '"\\ud800"',
    "control-codes": '"\\u001b[31mred\\u0007\\u009b"',
    "lines": '"a\\nb"',
    "path": '"../../../x"',
}
WHOLE = {
    "list": b"[]",
    "number": b"1",
    "text": b'"x"',
    "null": b"null",
    "nothing": b"{}",
    "deep": DEEP.encode(),
}
WHOLE |= {"utf-16": '{"a": 1}'.encode("utf-16"), "not-utf-8": b'{"a": "\xff\xfe"}', "twice": b"{}{}"}
_MARK = "@@@"


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values within a value."""
    found = [path] if path else []
    if isinstance(value, dict):
        found += [place for key, part in value.items() for place in _places(part, (*path, key))]
    elif isinstance(value, list) and len(value) < 10:
        found += [place for key, part in enumerate(value) for place in _places(part, (*path, key))]
    return found


def with_value(text: str, new: str, rng: random.Random) -> str:
    """JSON with another value, given as text, at a random place."""
    value = json.loads(text)
    *way, last = rng.choice(_places(value))
    part = value
    for key in way:
        part = part[key]
    part[last] = _MARK
    return json.dumps(value).replace(f'"{_MARK}"', new)


def _without(text: str, rng: random.Random) -> str:
    value = json.loads(text)
    *way, last = rng.choice([place for place in _places(value) if isinstance(place[-1], str)])
    part = value
    for key in way:
        part = part[key]
    del part[last]
    return json.dumps(value)


def _on_text(change: Callable[[str, random.Random], str]) -> Callable[[Path, random.Random], object]:
    return lambda path, rng: path.write_bytes(change(path.read_text(), rng).encode("utf-8", "surrogatepass"))


def _on_line(change: Callable[[str, random.Random], str]) -> Callable[[Path, random.Random], object]:
    """One line of a file of JSON lines."""

    def spoil(path: Path, rng: random.Random) -> None:
        lines = path.read_text().splitlines()
        number = rng.randrange(len(lines))
        lines[number] = change(lines[number], rng)
        path.write_text("\n".join(lines) + "\n")

    return spoil


def _on_header(
    inner: bool, change: Callable[[str, random.Random], str]
) -> Callable[[Path, random.Random], object]:
    """The header of a safetensors file, or the JSON of our own in it."""

    def spoil(path: Path, rng: random.Random) -> None:
        content = path.read_bytes()
        (size,) = struct.unpack("<Q", content[:8])
        header = content[8 : 8 + size].decode()
        if inner:
            stored = json.loads(header)
            stored["__metadata__"]["imgtransfer"] = change(stored["__metadata__"]["imgtransfer"], rng)
            header = json.dumps(stored)
        else:
            header = change(header, rng)
        text = header.encode()
        path.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + size :])

    return spoil


def _faults(place: Callable[[Callable[[str, random.Random], str]], Any], prefix: str) -> tuple[Fault, ...]:
    def to(new: str) -> Callable[[str, random.Random], str]:
        return lambda text, rng: with_value(text, new, rng)

    found = [Fault(f"{prefix}-{name}", place(to(new)), harmless=True) for name, new in VALUES.items()]
    return (*found, Fault(f"{prefix}-missing", place(_without), harmless=True))


VALUE_FAULTS = _faults(_on_text, "value")
LINE_FAULTS = _faults(_on_line, "line")
HEADER_FAULTS = _faults(lambda change: _on_header(False, change), "header")
SETTING_FAULTS = _faults(lambda change: _on_header(True, change), "setting")
WHOLE_FAULTS = tuple(
    Fault(f"json-{name}", lambda path, _, content=content: path.write_bytes(content), harmless=True)
    for name, content in WHOLE.items()
)
