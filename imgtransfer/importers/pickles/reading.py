"""Pickle files of public data sets, read without running anything that they ask for.

A pickle is a program: it names functions and calls them. Here every name is looked up in the short
table of stand-ins of `pickle_parts`; any other name stops the reading.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from imgtransfer.importers.pickles.stand_ins import NAMES, RefusedError, as_plain
from render import InputError, Option
from render.files.data_file import check_data_file


def load_pickle(path: str | Path, *, extra: Mapping[str, object] | None = None) -> Any:
    """Read a pickle that holds NumPy arrays, numbers, text, and dicts, lists, tuples and sets of them.

    Pickles of Python 2 are read with latin1, as NumPy's arrays need it; both of NumPy's module names are known.

    Args:
        path: the file.
        extra: stand-ins for further names, "module.name" or "package.*": subclasses of `Stored`, or `Maker`s.

    Raises:
        InputError: no such file, a damaged one, or one that asks for anything else; nothing of it was run then.
    """
    path = Path(path)
    check_data_file(path, "a pickle (.pkl)")
    with path.open("rb") as file:
        try:
            return as_plain(_Unpickler(file, extra or {}).load(), {})
        except RefusedError as error:
            raise InputError(f"{path}: {error}") from None
        except Exception as error:  # a damaged pickle makes the reader raise whatever it meets
            what = str(error) or "it asks for more memory than there is, or breaks off"
            raise InputError(f"{path}: not a whole pickle file, perhaps truncated ({what})") from error


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: BinaryIO, extra: Mapping[str, object]) -> None:
        super().__init__(file, encoding="latin1")
        self.names = {**NAMES, **extra}

    def find_class(self, module: str, name: str) -> Any:
        package = module.partition(".")[0]
        found = self.names.get(f"{module}.{name}", self.names.get(f"{package}.*"))
        if found is not None:
            return found
        if package == "chumpy":
            raise RefusedError(
                "holds chumpy objects, as files of the SMPL model do; data sets do not need them. If it is the "
                f"body model, give its folder by {Option('smpl')}"
            )
        if package == "scipy":
            raise RefusedError(
                f"holds {module}.{name}, a sparse matrix; store it as a plain array (.toarray()) first"
            )
        raise RefusedError(
            f"asks for {module}.{name}, which no data file needs; it was not run. Wanted are NumPy arrays and plain "
            "dicts, lists, numbers and text"
        )
