"""Faults of pickles, and of the arrays within them, within npy files and MAT files."""

from __future__ import annotations

import pickle
import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from tests.bad_inputs.case import Fault
from tests.bad_inputs.npz_faults import CHANGES, changed


class _Runs:
    """Unpickled, it would run a command that leaves a file."""

    def __reduce__(self) -> tuple[Any, ...]:
        import os  # noqa: PLC0415

        return (os.system, ("touch hacked",))


def _deep(depth: int) -> bytes:
    return b"\x80\x02" + b"]" * depth + b"a" * (depth - 1) + b"."


def _shape_alone(shape: tuple[int, ...]) -> bytes:
    """An array of one number that says it had another shape."""
    content = pickle.dumps(np.zeros((1,)), protocol=2)
    numbers = b"".join(b"\x8a\x08" + struct.pack("<q", n) for n in shape)
    return content.replace(b"K\x01\x85", b"(" + numbers + b"t", 1)


CONTENTS: dict[str, bytes] = {
    "runs-a-command": pickle.dumps({"poses": _Runs()}, protocol=2),
    "runs-at-once": pickle.dumps(_Runs(), protocol=4),
    "deep": _deep(200_000),
    "number": pickle.dumps(3),
    "list": pickle.dumps([1, 2]),
    "nothing": pickle.dumps({}),
    "no-frame": b"\x80\x04\x95" + b"\xff" * 8 + b".",
    "long-bytes": b"\x80\x04\x8e" + struct.pack("<Q", 2**60) + b"x.",
    "long-text": b"\x80\x04\x8d" + struct.pack("<Q", 2**60) + b"x.",
    "far-memo": b"\x80\x02Nr\xff\xff\xff\xff.",
    "no-memo": b"\x80\x02h\x07.",
    "empty-stack": b"\x80\x02a.",
    "no-mark": b"\x80\x02t.",
    "to-itself": b"\x80\x02}q\x00U\x01ah\x00s.",
    "persistent": b"\x80\x02U\x01aQ.",
    "other-protocol": b"\x80\x09}.",
    "unknown-class": b"\x80\x02cnowhere\nNothing\nq\x00)\x81.",
    "attribute": b"\x80\x04\x8c\x05numpy\x8c\x0bf2py.os.system\x93.",
    "digits": b"I" + b"9" * 5000 + b"\n.",
    "long-digits": b"\x80\x02\x8b\xff\xff\xff\x7f.",
    "array-of-a-tera": _shape_alone((2**40,)),
    "array-negative": _shape_alone((-5, 2)),
    "array-unhashable-key": b"\x80\x02}]K\x01s.",
    "not-utf-8": b"\x80\x02X\x02\x00\x00\x00\xff\xfe.",
}
PICKLES = tuple(
    Fault(f"pickle-{name}", lambda path, _, content=content: path.write_bytes(content))
    for name, content in CONTENTS.items()
)


def _entries(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of the numeric arrays in dictionaries of dictionaries."""
    if isinstance(value, dict):
        return [place for key, part in value.items() for place in _entries(part, (*path, key))]
    return [path] if isinstance(value, np.ndarray) and value.size and path else []


def _pick(value: dict[str, Any], kinds: str, rng: random.Random) -> tuple[dict[str, Any], Any]:
    """A dictionary in `value` and a key of it, whose array has numbers of these kinds."""

    def at(path: tuple[Any, ...]) -> Any:
        part: Any = value
        for key in path:
            part = part[key]
        return part

    numbers = [path for path in _entries(value) if at(path).dtype.kind in "fiub"]
    *way, last = rng.choice([path for path in numbers if at(path).dtype.kind in kinds] or numbers)
    return at(tuple(way)), last


def _in_pickle(name: str) -> Callable[[Path, random.Random], object]:
    change, kinds, _ = CHANGES[name]

    def spoil(path: Path, rng: random.Random) -> None:
        value = pickle.loads(path.read_bytes())  # of our own making
        part, key = _pick(value, kinds, rng)
        part[key] = changed(part[key], change, rng)
        path.write_bytes(pickle.dumps(value, protocol=2))

    return spoil


def _entry_lost(path: Path, rng: random.Random) -> None:
    value = pickle.loads(path.read_bytes())
    part, key = _pick(value, "fiu", rng)
    del part[key]
    path.write_bytes(pickle.dumps(value, protocol=2))


def _entry_replaced(path: Path, rng: random.Random) -> None:
    value = pickle.loads(path.read_bytes())
    part, key = _pick(value, "fiu", rng)
    part[key] = rng.choice((None, "words", 7, [1, [2]], {"a": 1}, b"x", float("nan")))
    path.write_bytes(pickle.dumps(value, protocol=2))


ENTRIES = (
    *(Fault(f"entry-{name}", _in_pickle(name), CHANGES[name][2]) for name in CHANGES),
    Fault("entry-missing", _entry_lost, harmless=True),
    Fault("entry-replaced", _entry_replaced, harmless=True),
)


def _in_npy(name: str) -> Callable[[Path, random.Random], object]:
    change = CHANGES[name][0]
    return lambda path, rng: np.save(path, changed(np.load(path), change, rng), allow_pickle=True)


def _in_mat(name: str) -> Callable[[Path, random.Random], object]:
    change, kinds, _ = CHANGES[name]

    def spoil(path: Path, rng: random.Random) -> None:
        stored = {key: value for key, value in scipy.io.loadmat(path).items() if not key.startswith("__")}
        part, key = _pick(stored, kinds, rng)
        part[key] = changed(part[key], change, rng)
        scipy.io.savemat(path, stored)

    return spoil


_NO_MAT = ("dates", "record", "half", "long-double", "other-order", "bytes", "objects")
NPY = tuple(
    Fault(f"npy-{name}", _in_npy(name), CHANGES[name][2]) for name in CHANGES if "f" in CHANGES[name][1]
)
MAT = tuple(Fault(f"mat-{name}", _in_mat(name), CHANGES[name][2]) for name in CHANGES if name not in _NO_MAT)
