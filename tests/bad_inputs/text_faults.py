"""Faults of text: single words of meshes, motions and lists, whole files of YAML."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path

from tests.bad_inputs.case import Fault

WORDS = {
    "nan": "nan",
    "inf": "-inf",
    "huge": "1e30",
    "vast": "1e300",
    "overflow": "1e999",
    "minus": "-7",
    "zero": "0",
    "large": "1000000000",
    "beyond-64-bits": "9" * 40,
    "digits": "9" * 5000,
    "letters": "x",
    "superscript": "²",
    "arabic": "٣",
    "slashes": "1//",
    "underscore": "1_0",
    "hex": "0x10",
    "nothing": "",
}


def _with_word(new: str) -> Callable[[Path, random.Random], object]:
    def spoil(path: Path, rng: random.Random) -> None:
        text = path.read_text()
        found = list(re.finditer(r"(?<=[\s,/:])-?\d[\d.e+-]*", text))
        place = rng.choice(found)
        path.write_text(text[: place.start()] + new + text[place.end() :])

    return spoil


def _on_lines(
    change: Callable[[list[str], random.Random], list[str]],
) -> Callable[[Path, random.Random], object]:
    def spoil(path: Path, rng: random.Random) -> None:
        path.write_text("\n".join(change(path.read_text().splitlines(), rng)) + "\n")

    return spoil


def _lost(lines: list[str], rng: random.Random) -> list[str]:
    at = rng.randrange(len(lines))
    return lines[:at] + lines[at + 1 :]


def _twice(lines: list[str], rng: random.Random) -> list[str]:
    at = rng.randrange(len(lines))
    return [*lines[: at + 1], *lines[at:]]


def _swapped(lines: list[str], rng: random.Random) -> list[str]:
    one, two = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[two] = lines[two], lines[one]
    return lines


def _long(lines: list[str], rng: random.Random) -> list[str]:
    at = rng.randrange(len(lines))
    return [*lines[:at], lines[at] + " 0" * 300_000, *lines[at + 1 :]]


def _bytes(content: bytes) -> Callable[[Path, random.Random], object]:
    return lambda path, _: path.write_bytes(content)


WORD_FAULTS = tuple(Fault(f"word-{name}", _with_word(new), harmless=True) for name, new in WORDS.items())
LINE_FAULTS = (
    Fault("line-lost", _on_lines(_lost), harmless=True),
    Fault("line-twice", _on_lines(_twice), harmless=True),
    Fault("lines-swapped", _on_lines(_swapped), harmless=True),
    Fault("line-long", _on_lines(_long), harmless=True),
)
BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join(['*' + old] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
YAMLS = {
    "list": b"[1, 2]",
    "text": b"just words",
    "number": b"3",
    "nothing": b"# nothing\n",
    "unknown": b"wings: 2\n",
    "not-text-keys": b"1: 2\n? [1]\n: 3\n",
    "open": b"a: [",
    "tabs": b"a:\n\t- b\n",
    "not-utf-8": b"a: \xff\xfe\n",
    "utf-16": "a: 1\n".encode("utf-16"),
    "null-byte": b"a: \0\n",
    "deep-lists": b"a: " + b"[" * 20_000,
    "deep-lists-closed": b"a: " + b"[" * 3000 + b"]" * 3000,
    "deep-blocks": b"".join(b" " * n + b"a:\n" for n in range(2000)),
    "alias-bomb": BOMB.encode(),
    "alias-to-itself": b"a: &a [*a]\n",
    "merge-to-itself": b"a: &a\n  <<: *a\n",
    "no-such-alias": b"a: *b\n",
    "python-object": b"a: !!python/object/apply:os.system ['touch hacked']\n",
    "date": b"a: 2024-13-45\n",
    "date-as-key": b"2024-01-01: 1\n",
    "digits": b"a: " + b"9" * 5000 + b"\n",
    "sexagesimal": b"a: 1:" + b"59:" * 2000 + b"59\n",
    "two-documents": b"a: 1\n---\nb: 2\n",
    "twice": b"a: 1\na: 2\n",
    "binary": b"a: !!binary '****'\n",
    "surrogate": b'a: "\\ud800"\n',
    "control-codes": b'"\\e[31mred": 1\n',
}
YAML_FAULTS = tuple(
    Fault(f"yaml-{name}", _bytes(content), harmless=name == "nothing") for name, content in YAMLS.items()
)
