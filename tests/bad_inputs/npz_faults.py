"""Faults of arrays in npz files: values, shapes, number types, headers that lie, members that are no arrays."""

from __future__ import annotations

import io
import pickle
import random
import struct
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.bad_inputs.case import Fault

Change = Callable[[np.ndarray, random.Random], object]


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a good npz."""
    with np.load(path) as stored:
        return dict(stored)


def _write(path: Path, arrays: dict[str, np.ndarray], raw: dict[str, bytes] | None = None) -> None:
    np.savez(path.with_suffix(".new.npz"), **arrays)
    path.with_suffix(".new.npz").rename(path)
    with warnings.catch_warnings(), zipfile.ZipFile(path, "a") as archive:
        warnings.simplefilter("ignore")  # of two members of one name
        for name, content in (raw or {}).items():
            archive.writestr(name, content)


def changed(values: np.ndarray, change: Change, rng: random.Random) -> np.ndarray:
    """The array with a change, as an array."""
    return np.asarray(change(values.copy(), rng))


def _at_random(value: float, dtype: str | None = None) -> Change:
    """One value, or all of them."""

    def change(values: np.ndarray, rng: random.Random) -> np.ndarray:
        values = values.astype(
            dtype or ("f8" if values.dtype.kind in "iub" and not np.isfinite(value) else values.dtype)
        )
        if rng.random() < 0.3:
            values[...] = value
        else:
            values.reshape(-1)[rng.randrange(values.size)] = value
        return values

    return change


# name: change, kinds of numbers that it is for, whether the outcome may be good input
CHANGES: dict[str, tuple[Change, str, bool]] = {
    "nan": (_at_random(np.nan), "f", False),
    "inf": (_at_random(-np.inf), "f", False),
    "huge": (_at_random(1e30), "f", True),
    "vast": (_at_random(1e300, "f8"), "f", True),
    "zero": (lambda a, _: a * 0, "fiu", True),
    "minus-one": (_at_random(-1), "i", True),
    "index-beyond": (_at_random(10**9), "iu", True),
    "index-64-bits": (_at_random(2**63 - 1, "i8"), "iu", True),
    "index-unsigned": (lambda a, _: a.astype("u8") + np.uint64(2**63), "iu", True),
    "fractions": (lambda a, _: a + 0.5, "iu", True),
    "text": (lambda a, _: a.astype("U8"), "fiu", False),
    "bytes": (lambda a, _: a.astype("S8"), "fiu", False),
    "complex": (lambda a, _: a + 1j, "fiu", True),
    "bool": (lambda a, _: a > 0, "fiu", True),
    "dates": (lambda a, _: np.full(a.shape, np.datetime64("2024-01-01")), "fiu", False),
    "record": (lambda a, _: np.zeros(a.shape, [("x", "f4"), ("y", "f4")]), "fiu", False),
    "objects": (lambda a, _: np.array([{"a": 1}] * 2, object), "fiub", False),
    "scalar": (lambda a, _: np.float64(1), "fiub", True),
    "no-rows": (lambda a, _: a[:0] if a.ndim else a, "fiub", True),
    "one-row": (lambda a, _: a[:1] if a.ndim else a, "fiub", True),
    "more-rows": (lambda a, _: np.repeat(a, 2, 0) if a.ndim else a, "fiub", True),
    "more-axes": (lambda a, _: a[None, None], "fiub", True),
    "flat": (lambda a, _: a.reshape(-1), "fiub", True),
    "turned": (lambda a, _: a.T, "fiub", True),
    "mirrored": (lambda a, _: a * -1 if a.dtype.kind in "fi" else a, "fi", True),
    "other-order": (lambda a, _: np.asfortranarray(a.astype(a.dtype.newbyteorder())), "fiu", True),
    "half": (lambda a, _: a.astype("f2"), "f", True),
    "long-double": (lambda a, _: a.astype("longdouble"), "f", True),
}


def _array_fault(name: str) -> Fault:
    change, kinds, harmless = CHANGES[name]

    def spoil(path: Path, rng: random.Random) -> None:
        arrays = arrays_of(path)
        numbers = [
            key for key, values in sorted(arrays.items()) if values.dtype.kind in "fiub" and values.size
        ]
        key = rng.choice([key for key in numbers if arrays[key].dtype.kind in kinds] or numbers)
        _write(path, arrays | {key: changed(arrays[key], change, rng)})

    return Fault(f"array-{name}", spoil, harmless)


def _without(path: Path, rng: random.Random) -> None:
    arrays = arrays_of(path)
    del arrays[rng.choice(sorted(arrays))]
    _write(path, arrays)


def _raw(make: Callable[[np.ndarray, random.Random], bytes], ending: str = ".npy") -> Callable[..., object]:
    """One member's bytes in place of an array."""

    def spoil(path: Path, rng: random.Random) -> None:
        arrays = arrays_of(path)
        key = rng.choice(sorted(arrays))
        values = arrays.pop(key)
        _write(path, arrays, {key + ending: make(values, rng)})

    return spoil


def _npy(header: str, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = header.encode() + b"\n"
    size = struct.pack("<H" if version == b"\x01\x00" else "<I", len(text))
    return b"\x93NUMPY" + version + size + text + body


def _lying(shape: str, descr: str = "'<f4'") -> Callable[..., bytes]:
    return lambda values, rng: _npy(
        f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}", b"\0" * 64
    )


def _whole_npy(values: np.ndarray, _: random.Random) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def _in_zip(offset: int, value: int) -> Callable[..., object]:
    """Another value of a field of two bytes in the entries of the zip file's directory, and in the first local one."""

    def spoil(path: Path, rng: random.Random) -> None:
        content = bytearray(path.read_bytes())
        for signature, shift in ((b"PK\x01\x02", 2), (b"PK\x03\x04", 0)):
            at = content.find(signature)
            struct.pack_into("<H", content, at + offset + shift, value)
        path.write_bytes(content)

    return spoil


def _twice(path: Path, rng: random.Random) -> None:
    arrays = arrays_of(path)
    key = rng.choice(sorted(arrays))
    _write(
        path, arrays, {f"{key}.npy": _whole_npy(arrays[key][:0] if arrays[key].ndim else arrays[key], rng)}
    )


STRUCTURE = (
    Fault("array-missing", _without, harmless=True),
    Fault("array-twice", _twice, harmless=True),
    Fault("header-112-gib", _raw(_lying("(10000, 1000000, 3)"))),
    Fault("header-too-long", _raw(_lying(f"({2**62}, {2**62}, 3)"))),
    Fault("header-negative", _raw(_lying("(-1, 3)"))),
    Fault("header-deep", _raw(lambda v, r: _npy("(" * 9000 + ")" * 9000, version=b"\x02\x00"))),
    Fault("header-words", _raw(lambda v, r: _npy("{'descr': __import__('os')}"))),
    Fault("header-no-size", _raw(_lying("(3,)", "'|S0'"))),
    Fault("header-version", _raw(lambda v, r: _npy("{}", version=b"\x09\x00"))),
    Fault("member-text", _raw(lambda v, r: b"hello")),
    Fault("member-empty", _raw(lambda v, r: b"")),
    Fault("member-pickle", _raw(lambda v, r: pickle.dumps([1, 2]))),
    Fault("member-other-name", _raw(_whole_npy, ending=".txt"), harmless=True),  # as if it were missing
    Fault("zip-encrypted", _in_zip(6, 1)),
    Fault("zip-compression", _in_zip(8, 99)),
    Fault("zip-no-arrays", lambda path, rng: _write(path, {})),
    Fault("bare-array", lambda path, rng: path.write_bytes(_whole_npy(np.zeros(3), rng))),
)
ARRAYS = tuple(_array_fault(name) for name in CHANGES)
