"""Pickles of the SMPL body model: besides arrays they hold objects of chumpy and SciPy, which stand for arrays.

The files of SMPL 1.0.0 and 1.1.0 were written by Python 2. chumpy does not work beside a present NumPy, so users
would be stuck; and reading them with it would run what they say. Their state is enough: `Ch` keeps its array as `x`,
`Select` takes `idxs` of the flat array `a` (chumpy 0.70, `ch.py` and `reordering.py`); SciPy's matrices keep `data`,
`indices`, `indptr` and `_shape`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array

from imgtransfer.importers.files import as_array
from imgtransfer.importers.pickles.reading import load_pickle
from imgtransfer.importers.pickles.stand_ins import Maker, RefusedError, Stored

_LARGEST_MATRIX = 1 << 27  # numbers; SMPL's regressor has 24 x 6,890


def load_model_pickle(path: str | Path) -> Any:
    """`load_pickle` for files of the SMPL model: objects of chumpy and sparse matrices become arrays.

    Objects of chumpy that stand for a computation, not for stored or selected values, become None.

    Raises:
        InputError: as `load_pickle`.
    """
    return load_pickle(path, extra=_NAMES)


class _Ch(Stored):
    """chumpy.ch.Ch, an array."""

    __slots__ = ()

    def plain(self, plain: Callable[[Any], Any]) -> np.ndarray:
        return as_array("chumpy.Ch", "x", plain(self.state["x"]))


class _Select(Stored):
    """chumpy.reordering.Select, some values of another."""

    __slots__ = ()

    def plain(self, plain: Callable[[Any], Any]) -> np.ndarray:
        values, chosen = (as_array("chumpy.Select", key, plain(self.state[key])) for key in ("a", "idxs"))
        values = values.ravel()[chosen]
        shape = self.state.get("preferred_shape")
        return values if shape is None else values.reshape(plain(shape))


class _Columns(Stored):
    """scipy.sparse.csc_matrix."""

    __slots__ = ()
    kind: type = csc_array

    def plain(self, plain: Callable[[Any], Any]) -> np.ndarray:
        parts = tuple(plain(self.state[key]) for key in ("data", "indices", "indptr"))
        rows, columns = plain(self.state.get("_shape", self.state.get("shape")))
        if rows * columns > _LARGEST_MATRIX:
            raise RefusedError(f"holds a sparse matrix of {rows} x {columns}, which is of no body")
        sparse = self.kind(parts, shape=(rows, columns))
        sparse.check_format(full_check=True)  # indices out of range would be read from elsewhere
        return sparse.toarray()


class _Rows(_Columns):
    """scipy.sparse.csr_matrix."""

    __slots__ = ()
    kind = csr_array


def _reconstructed(kind: object, *_: object) -> Stored:
    """What `copy_reg._reconstructor` makes for objects of Python 2's protocols 0 and 1."""
    if not (isinstance(kind, type) and issubclass(kind, Stored)):
        raise TypeError("an object of an unknown class")
    return kind()


_NAMES: dict[str, object] = {
    "chumpy.*": Stored,
    "chumpy.ch.Ch": _Ch,
    "chumpy.reordering.Select": _Select,
    **{f"{module}._reconstructor": Maker(_reconstructed) for module in ("copy_reg", "copyreg")},
    **{f"{module}.object": Maker(lambda *_: None) for module in ("builtins", "__builtin__")},
    **{f"scipy.sparse.{module}.csc_matrix": _Columns for module in ("csc", "_csc")},
    **{f"scipy.sparse.{module}.csr_matrix": _Rows for module in ("csr", "_csr")},
}
