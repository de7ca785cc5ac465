"""Arrays of data sets, from files and from lists, whose shape is checked."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from render import InputError
from render.files.data_file import check_data_file
from render.files.npz import open_npz, read_npy

_MOST_ENTRIES = 10_000_000
_LARGEST = 1e12  # beyond anything that a data set means, and its square is still a float32


def load_arrays(path: Path, wanted: Iterable[str]) -> dict[str, np.ndarray]:
    """The arrays of an npz, never unpickling.

    Raises:
        InputError: no such file, a damaged one, or an array of `wanted` that it lacks.
    """
    wanted = list(wanted)
    what = f"an npz with {', '.join(wanted)}"
    check_data_file(path, what)
    with open_npz(path, what) as npz:
        missing = [key for key in wanted if key not in npz]
        if missing:
            raise InputError(
                f"{path}: lacks {', '.join(missing)}; it has {', '.join(npz.names) or 'nothing'}"
            )
        return {key: npz.read(key) for key in wanted}


def load_array(path: Path) -> np.ndarray:
    """The array of an npy file, never unpickling.

    Raises:
        InputError: no such file, or a damaged one.
    """
    check_data_file(path, "an npy array")
    return read_npy(path)


def as_array(source: str, name: str, values: object) -> np.ndarray:
    """The value as an array.

    Raises:
        InputError: lists within lists whose lengths differ, or so many of them that they would fill the memory: a
            list may hold another many times without being any larger.
    """
    waiting, count = [values], 0
    while waiting:
        value = waiting.pop()
        count += 1
        if isinstance(value, list | tuple):
            waiting += value
        if count + len(waiting) > _MOST_ENTRIES:
            raise InputError(
                f"{source}: {name} holds more than {_MOST_ENTRIES} numbers in lists; an array is wanted"
            )
    try:
        return np.asarray(values)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{source}: {name} must be an array of numbers ({error})") from error


def check_shape(source: str, name: str, values: object, shape: tuple[int | None, ...]) -> np.ndarray:
    """The value as an array of finite numbers of `shape`, where None stands for any length but 0.

    Raises:
        InputError: another shape, or no numbers; the message names `source` and `name`.
    """
    array = as_array(source, name, values)
    expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    fits = array.ndim == len(shape) and all(w in (None, n) for w, n in zip(shape, array.shape, strict=True))
    if array.dtype.kind not in "fiu" or not fits or array.size == 0:
        raise InputError(
            f"{source}: {name} must be numbers of shape {expected}, found {array.dtype} {array.shape}"
        )
    largest = float(np.abs(array).max())
    if not largest <= _LARGEST:  # also where it is not a number
        raise InputError(f"{source}: {name} holds {largest:.3g}, which is not finite or beyond {_LARGEST:g}")
    return array
