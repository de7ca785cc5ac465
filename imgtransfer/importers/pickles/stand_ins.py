"""Stand-ins for what pickles of data sets name: they build arrays and plain containers, and nothing else.

No class or function of NumPy itself is handed to a pickle, because several of them (`numpy.load`, helpers of
`numpy.testing`) can be made to run code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class RefusedError(Exception):
    """The pickle asks for something that data does not need."""


class Maker:
    """A function for the unpickler to call, which cannot be changed by it."""

    __slots__ = ("_make",)

    def __init__(self, make: Callable[..., Any]) -> None:
        self._make = make

    def __call__(self, *args: Any) -> Any:
        return self._make(*args)

    def __setstate__(self, state: object) -> None:
        raise RefusedError("changes the functions that read it; it is not a data file")


class Stored:
    """An object of another library, of which only the state is read; a subclass says what array it stands for."""

    __slots__ = ("state",)
    state: dict[str, Any]

    def __new__(cls, *_: object) -> Stored:
        """Take whatever the pickle gives, and use none of it."""
        made = super().__new__(cls)
        made.state = {}
        return made

    def __setstate__(self, state: object) -> None:
        if not isinstance(state, dict):
            raise RefusedError(f"holds a {type(self).__name__} without its values")
        self.state = state

    def plain(self, plain: Callable[[Any], Any]) -> np.ndarray | None:
        """The array, None where it is not known; `plain` turns what is stored in it into arrays first."""
        return None


class _DType:
    """`numpy.dtype` under construction: the name, then the byte order by `__setstate__`."""

    __slots__ = ("value",)

    def __init__(self, name: object, *_: object) -> None:
        if not isinstance(name, str):
            raise RefusedError(f"holds arrays of type {name!r}, wanted are numbers and text")
        self.value = np.dtype(name)
        if self.value.hasobject and self.value != np.dtype("O"):
            raise RefusedError(f"holds arrays of type {name!r}, wanted are numbers and text")

    def __setstate__(self, state: tuple) -> None:
        if len(state) < 4 or state[2] is not None or state[3] is not None:
            raise RefusedError("holds structured arrays; wanted are plain ones")
        if state[1] in ("<", ">"):
            self.value = self.value.newbyteorder(state[1])


class _Array:
    """`numpy.ndarray` under construction, filled by `__setstate__`."""

    __slots__ = ("value",)

    def __init__(self, value: np.ndarray | None = None) -> None:
        self.value = value

    def __setstate__(self, state: tuple) -> None:
        shape, dtype, fortran, content = state[-4:]
        self.value = _filled(shape, dtype, "F" if fortran else "C", content)


def _filled(shape: object, dtype: object, order: str, content: object) -> np.ndarray:
    """An array of `shape` from bytes, or from a list where its elements are objects."""
    if not isinstance(dtype, _DType) or not isinstance(shape, tuple):
        raise RefusedError("holds an array without a plain type or shape")
    if dtype.value.hasobject:
        if not isinstance(content, list):
            raise RefusedError("holds an object array that is no list")
        entries = np.empty(len(content), object)
        entries[:] = content
        return entries.reshape(shape, order="F" if order == "F" else "C")
    if isinstance(content, str):  # the bytes of Python 2
        content = content.encode("latin1")
    if not isinstance(content, bytes | bytearray):
        raise RefusedError("holds an array whose content is no bytes")
    values = np.frombuffer(content, dtype.value).reshape(shape, order="F" if order == "F" else "C")
    return np.array(values, dtype.value.newbyteorder("="))


def _empty_array(kind: object, *_: object) -> _Array:
    if kind is not _NDARRAY:
        raise RefusedError("holds an array of an unknown class")
    return _Array()


def _from_buffer(content: object, dtype: object, shape: object, order: object = "C") -> _Array:
    return _Array(_filled(shape, dtype, str(order), content))


def _scalar(dtype: object, content: object = b"") -> Any:
    if isinstance(dtype, _DType) and dtype.value.hasobject:
        raise RefusedError("holds a scalar of type object")
    return _filled((), dtype, "C", content)[()]


def _encoded(text: str, encoding: str) -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise RefusedError(f"holds bytes written as {encoding}")
    return text.encode("latin1")


_NDARRAY = Maker(lambda *_: _Array())
_BUILTINS: dict[str, Callable[..., Any]] = {
    "set": set,
    "frozenset": frozenset,
    "complex": complex,
    "bytes": lambda: b"",
}
_ARRAYS: dict[str, Callable[..., Any]] = {
    "multiarray._reconstruct": _empty_array,
    "multiarray.scalar": _scalar,
    "numeric._frombuffer": _from_buffer,
}
NAMES = {
    "numpy.ndarray": _NDARRAY,
    "numpy.dtype": Maker(_DType),
    "_codecs.encode": Maker(_encoded),
    "collections.OrderedDict": Maker(dict),
    # Python 3 and 2, and NumPy from version 2 on and before.
    **{
        f"{where}.{name}": Maker(make)
        for where in ("builtins", "__builtin__")
        for name, make in _BUILTINS.items()
    },
    **{f"numpy.{core}.{name}": Maker(make) for core in ("_core", "core") for name, make in _ARRAYS.items()},
}


def as_plain(value: Any, done: dict[int, Any]) -> Any:
    """Replace what is under construction by arrays, all the way down; each object once, however often it is held."""
    if isinstance(value, Maker | type):
        raise RefusedError("holds a function, not data")
    if not isinstance(value, _Array | _DType | Stored | dict | list | tuple | set | frozenset):
        return value
    if id(value) not in done:
        done[id(value)] = value  # against endless loops: a container inside itself stays as it is
        done[id(value)] = _made_plain(value, done)
    return done[id(value)]


def _made_plain(value: Any, done: dict[int, Any]) -> Any:
    if isinstance(value, _Array):
        if value.value is None:
            raise ValueError("an array without content")
        if value.value.dtype == object:
            flat = [as_plain(entry, done) for entry in value.value.reshape(-1).tolist()]
            return _filled(value.value.shape, _DType("O"), "C", flat)
        return value.value
    if isinstance(value, _DType):
        return value.value
    if isinstance(value, Stored):
        return value.plain(lambda entry: as_plain(entry, done))
    if isinstance(value, dict):
        return {as_plain(key, done): as_plain(entry, done) for key, entry in value.items()}
    return type(value)(as_plain(entry, done) for entry in value)
