"""Constant sparse matrices on batched dense tensors: what maps, normals and the fusion's sums are made by."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse
import torch

from render.errors import InputError

_LARGE = 2**17  # numbers in one frame of a result: half a megabyte in float32
_NUMPY = {torch.float32: np.float32, torch.float64: np.float64}


class SparseProduct:
    """A constant sparse matrix that multiplies the second last axis of batched dense tensors.

    The matrix is copied to a device and dtype on first use there, and kept. The product is differentiable in
    the dense factor, any number of times: its gradient is the product with the transpose.

    Args:
        rows, columns: (K,) integer, places of the entries, any order; repeated places are summed.
        values: (K,) floating point.
        shape: (rows, columns) of the matrix.
    """

    def __init__(
        self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]
    ) -> None:
        self.shape = shape
        entries = np.asarray(values, np.float64), (np.asarray(rows), np.asarray(columns))
        self._entries = scipy.sparse.csr_matrix(entries, shape=shape)
        self._entries.sum_duplicates()
        self._placed: dict[tuple[torch.device, torch.dtype, bool], _Matrix] = {}

    def __call__(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., columns, C) to (..., rows, C)."""
        return _product(dense, self, transposed=False)

    def transposed(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., rows, C) to (..., columns, C)."""
        return _product(dense, self, transposed=True)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles rebuild the matrix: torch can copy no CSR tensors."""
        entries = self._entries.tocoo()
        return SparseProduct, (entries.row, entries.col, entries.data, self.shape)

    def placed(self, device: torch.device, dtype: torch.dtype, *, transposed: bool = False) -> _Matrix:
        """The matrix or its transpose on a device; float32 and float64 only (TypeError)."""
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(
                f"interpolation needs float32 or float64, found {dtype}: geometry loses too much below"
            )
        key = device, dtype, transposed
        if key not in self._placed:
            # Made when first asked for: without gradients, most matrices are never transposed.
            entries = self._entries.T.tocsr() if transposed else self._entries
            self._placed[key] = _Matrix(entries, device, dtype)
        return self._placed[key]


def differences(pairs: np.ndarray, n_vertices: int) -> SparseProduct:
    """(P, 2) vertex pairs -> (P, N) matrix whose row p is the first minus the second."""
    rows = np.repeat(np.arange(len(pairs)), 2)
    return SparseProduct(rows, pairs.ravel(), np.tile([1.0, -1.0], len(pairs)), (len(pairs), n_vertices))


class _Matrix:
    """One sparse matrix on one device in one dtype, in the form whose product is fastest there.

    In float32 that is a sum of weighted bags of rows (scripts/bench/render.py compares), in float64 CSR: on CPUs
    SciPy's, which sums in one order for any number of columns. What torch calls there does not, on some processors.
    """

    def __init__(self, entries: scipy.sparse.csr_matrix, device: torch.device, dtype: torch.dtype) -> None:
        #: (U,) int64, the only columns with entries, where most have none: `times` takes these rows of the dense factor
        #: alone. A picture's pixels are several times those that its readings look at. None: all.
        self.used: torch.Tensor | None = None
        used = np.unique(entries.indices)
        if 0 < 2 * len(used) < entries.shape[1]:
            self.used, entries = torch.from_numpy(used.astype(np.int64)).to(device), entries[:, used]
        csr = _csr(entries).to(device=device, dtype=dtype)
        self.shape = csr.shape
        self._csr: torch.Tensor | scipy.sparse.csr_matrix | None = None
        if dtype == torch.float64:
            self._csr = csr if device.type != "cpu" else entries
        self._starts, self._columns = csr.crow_indices().int(), csr.col_indices().int()
        self._values = csr.values()

    def times(self, dense: torch.Tensor) -> torch.Tensor:
        """(columns or U, C) to (rows, C)."""
        if isinstance(self._csr, torch.Tensor):
            return self._csr @ dense
        if self._csr is not None:
            return torch.from_numpy(self._csr @ dense.numpy())
        if len(self._values) == 0 or dense.numel() == 0:
            return dense.new_zeros(self.shape[0], dense.shape[1])
        return torch.nn.functional.embedding_bag(
            self._columns,
            dense.contiguous(),
            self._starts,
            per_sample_weights=self._values,
            mode="sum",
            include_last_offset=True,
        )


def _csr(entries: scipy.sparse.csr_matrix) -> torch.Tensor:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparse CSR tensor support is in beta state", UserWarning)
        return torch.sparse_csr_tensor(
            torch.from_numpy(entries.indptr.astype(np.int64)),
            torch.from_numpy(entries.indices.astype(np.int64)),
            torch.from_numpy(entries.data),
            size=entries.shape,
            check_invariants=False,
        )


def _product(dense: torch.Tensor, product: SparseProduct, *, transposed: bool) -> torch.Tensor:
    """Any leading axes become one of frames, and are put back."""
    rows, columns = product.shape[::-1] if transposed else product.shape
    if dense.shape[-2] != columns:
        raise InputError(f"{columns} values expected along the second last axis, found {tuple(dense.shape)}")
    frames = dense.shape[:-2].numel()
    found = _sparse_dense(dense.reshape(frames, *dense.shape[-2:]), product, transposed)
    return found.reshape(*dense.shape[:-2], rows, dense.shape[-1])


class _SparseDense(torch.autograd.Function):
    """matrix @ dense for dense (T, columns, C); torch's own would build the transpose again at every backward."""

    @staticmethod
    def forward(ctx: Any, dense: torch.Tensor, product: SparseProduct, transposed: bool) -> torch.Tensor:
        ctx.product, ctx.transposed = product, transposed
        with torch.autocast(dense.device.type, enabled=False):
            return _frames_product(dense, product.placed(dense.device, dense.dtype, transposed=transposed))

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        return _sparse_dense(gradient, ctx.product, not ctx.transposed), None, None


_sparse_dense: Callable[[torch.Tensor, SparseProduct, bool], torch.Tensor] = _SparseDense.apply


def _frames_product(dense: torch.Tensor, matrix: _Matrix) -> torch.Tensor:
    """(T, columns, C) to (T, rows, C).

    One product whose columns are all frames' channels, whose result lies in memory as (rows, T, C); but large
    frames on a CPU one after the other, straight to their places, which spares turning megabytes round.
    """
    if matrix.used is not None and dense.numel():
        dense = dense.index_select(1, matrix.used)
    frames, columns, channels = dense.shape
    rows = matrix.shape[0]
    if frames <= 1:
        return matrix.times(dense.reshape(columns, -1)).reshape(frames, rows, channels)
    if dense.device.type == "cpu" and dense.is_contiguous() and rows * channels > _LARGE:
        # NumPy asks the system for huge pages, torch does not: fresh pages of 4 KiB would take most of the time.
        product = torch.from_numpy(np.empty((frames, rows, channels), _NUMPY[dense.dtype]))
        for place, frame in zip(product, dense, strict=True):
            place.copy_(matrix.times(frame))
        return product
    folded = dense.transpose(0, 1).reshape(columns, -1)
    return matrix.times(folded).reshape(rows, frames, channels).transpose(0, 1)
