"""Constant sparse matrices on batched dense tensors: what maps, normals and the fusion's sums are made by."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
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
        self._forward = _csr(rows, columns, values, shape)
        self._transposed = _csr(columns, rows, values, shape[::-1])
        self._placed: dict[tuple[torch.device, torch.dtype], tuple[_Matrix, _Matrix]] = {}

    def __call__(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., columns, C) to (..., rows, C)."""
        forward, transposed = self.placed(dense.device, dense.dtype)
        return _product(dense, forward, transposed)

    def transposed(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., rows, C) to (..., columns, C)."""
        forward, transposed = self.placed(dense.device, dense.dtype)
        return _product(dense, transposed, forward)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles rebuild the matrix: torch can copy no CSR tensors."""
        entries = self._forward.to_sparse_coo()
        rows, columns = entries.indices().numpy()
        return SparseProduct, (rows, columns, entries.values().numpy(), self.shape)

    def placed(self, device: torch.device, dtype: torch.dtype) -> tuple[_Matrix, _Matrix]:
        """Copy the matrix and its transpose to a device; float32 and float64 only (TypeError)."""
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(
                f"interpolation needs float32 or float64, found {dtype}: geometry loses too much below"
            )
        if (device, dtype) not in self._placed:
            self._placed[device, dtype] = (
                _Matrix(self._forward.to(device=device, dtype=dtype)),
                _Matrix(self._transposed.to(device=device, dtype=dtype)),
            )
        return self._placed[device, dtype]


def differences(pairs: np.ndarray, n_vertices: int) -> SparseProduct:
    """(P, 2) vertex pairs -> (P, N) matrix whose row p is the first minus the second."""
    rows = np.repeat(np.arange(len(pairs)), 2)
    return SparseProduct(rows, pairs.ravel(), np.tile([1.0, -1.0], len(pairs)), (len(pairs), n_vertices))


class _Matrix:
    """One sparse matrix on one device in one dtype, in the form whose product is fastest there.

    In float32 that is a sum of weighted bags of rows (scripts/bench/render.py compares), in float64 CSR.
    """

    def __init__(self, csr: torch.Tensor) -> None:
        self.shape = csr.shape
        self._csr = csr if csr.dtype == torch.float64 else None
        self._starts, self._columns = csr.crow_indices().int(), csr.col_indices().int()
        self._values = csr.values()

    def times(self, dense: torch.Tensor) -> torch.Tensor:
        """(columns, C) to (rows, C)."""
        if self._csr is not None:
            return self._csr @ dense
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


def _csr(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]) -> torch.Tensor:
    places = torch.from_numpy(np.stack([rows, columns]).astype(np.int64))
    entries = torch.from_numpy(np.asarray(values, np.float64))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparse CSR tensor support is in beta state", UserWarning)
        return (
            torch.sparse_coo_tensor(places, entries, shape, check_invariants=True).coalesce().to_sparse_csr()
        )


def _product(dense: torch.Tensor, matrix: _Matrix, transposed: _Matrix) -> torch.Tensor:
    """Any leading axes become one of frames, and are put back."""
    if dense.shape[-2] != matrix.shape[1]:
        raise InputError(
            f"{matrix.shape[1]} values expected along the second last axis, found {tuple(dense.shape)}"
        )
    frames = dense.shape[:-2].numel()
    product = _sparse_dense(dense.reshape(frames, *dense.shape[-2:]), matrix, transposed)
    return product.reshape(*dense.shape[:-2], matrix.shape[0], dense.shape[-1])


class _SparseDense(torch.autograd.Function):
    """matrix @ dense for dense (T, columns, C); torch's own would build the transpose again at every backward."""

    @staticmethod
    def forward(ctx: Any, dense: torch.Tensor, matrix: _Matrix, transposed: _Matrix) -> torch.Tensor:
        ctx.matrices = matrix, transposed
        with torch.autocast(dense.device.type, enabled=False):
            return _frames_product(dense, matrix)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        matrix, transposed = ctx.matrices
        return _sparse_dense(gradient, transposed, matrix), None, None


_sparse_dense: Callable[[torch.Tensor, _Matrix, _Matrix], torch.Tensor] = _SparseDense.apply


def _frames_product(dense: torch.Tensor, matrix: _Matrix) -> torch.Tensor:
    """(T, columns, C) to (T, rows, C).

    One product whose columns are all frames' channels, whose result lies in memory as (rows, T, C); but large
    frames on a CPU one after the other, straight to their places, which spares turning megabytes round.
    """
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
