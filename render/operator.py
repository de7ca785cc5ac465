"""The interpolation B: from values at vertices to images, and back by its adjoint."""

from __future__ import annotations

import warnings

import numpy as np
import torch

from render.errors import InputError
from render.raster import Raster


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
        self._placed: dict[tuple[torch.device, torch.dtype], tuple[torch.Tensor, torch.Tensor]] = {}

    def __call__(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., columns, C) to (..., rows, C)."""
        forward, transposed = self.placed(dense.device, dense.dtype)
        return _product(dense, forward, transposed)

    def transposed(self, dense: torch.Tensor) -> torch.Tensor:
        """(..., rows, C) to (..., columns, C)."""
        forward, transposed = self.placed(dense.device, dense.dtype)
        return _product(dense, transposed, forward)

    def __reduce__(self) -> tuple:
        """Copies and pickles rebuild the matrix: torch can copy no CSR tensors."""
        entries = self._forward.to_sparse_coo()
        rows, columns = entries.indices().numpy()
        return SparseProduct, (rows, columns, entries.values().numpy(), self.shape)

    def placed(self, device: torch.device, dtype: torch.dtype) -> tuple[torch.Tensor, torch.Tensor]:
        """The matrix and its transpose as CSR tensors on a device; float32 and float64 only (TypeError)."""
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(
                f"interpolation needs float32 or float64, found {dtype}: geometry loses too much below"
            )
        if (device, dtype) not in self._placed:
            self._placed[device, dtype] = (
                self._forward.to(device=device, dtype=dtype),
                self._transposed.to(device=device, dtype=dtype),
            )
        return self._placed[device, dtype]


def _csr(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]) -> torch.Tensor:
    places = torch.from_numpy(np.stack([rows, columns]).astype(np.int64))
    entries = torch.from_numpy(np.asarray(values, np.float64))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparse CSR tensor support is in beta state", UserWarning)
        return (
            torch.sparse_coo_tensor(places, entries, shape, check_invariants=True).coalesce().to_sparse_csr()
        )


def _product(dense: torch.Tensor, matrix: torch.Tensor, transposed: torch.Tensor) -> torch.Tensor:
    """Fold the batch and channels into the columns of one dense factor, multiply, unfold."""
    batch, channels = dense.shape[:-2], dense.shape[-1]
    if dense.shape[-2] != matrix.shape[1]:
        raise InputError(
            f"{matrix.shape[1]} values expected along the second last axis, found {tuple(dense.shape)}"
        )
    folded = dense.reshape(-1, matrix.shape[1], channels).transpose(0, 1).reshape(matrix.shape[1], -1)
    product = _SparseDense.apply(folded, matrix, transposed)
    return (
        product.reshape(matrix.shape[0], -1, channels)
        .transpose(0, 1)
        .reshape(*batch, matrix.shape[0], channels)
    )


class _SparseDense(torch.autograd.Function):
    """matrix @ dense; torch's own would build the transpose again at every backward."""

    @staticmethod
    def forward(ctx, dense, matrix, transposed):  # type: ignore[no-untyped-def]
        ctx.matrices = matrix, transposed
        with torch.autocast(dense.device.type, enabled=False):
            return matrix @ dense

    @staticmethod
    def backward(ctx, gradient):  # type: ignore[no-untyped-def]
        matrix, transposed = ctx.matrices
        return _SparseDense.apply(gradient.contiguous(), transposed, matrix), None, None


class MapOperator:
    """The renderer f_r of equation 1 of the paper as one constant sparse matrix B (pixels × vertices).

    Each covered pixel's row holds the barycentric weights of its face's three vertices. Device and dtype
    (float32 or float64) follow the tensors it is given.

    Args:
        raster: of the template, S views of H × W pixels.
        faces: (F, 3) int64, those that were rasterised.
        n_vertices: N.
    """

    def __init__(self, raster: Raster, faces: np.ndarray, n_vertices: int) -> None:
        pixels = np.flatnonzero(raster.mask)
        self._shape = raster.face_id.shape
        self._product = SparseProduct(
            rows=np.repeat(pixels, 3),
            columns=np.asarray(faces)[raster.face_id.reshape(-1)[pixels]].reshape(-1),
            values=raster.barycentric.reshape(-1, 3)[pixels].reshape(-1),
            shape=(raster.face_id.size, n_vertices),
        )
        self.mask = torch.from_numpy(raster.mask)

    def __call__(self, attributes: torch.Tensor) -> torch.Tensor:
        """Images of values at vertices, differentiable in the values.

        Args:
            attributes: (..., N, C).

        Returns:
            (..., S, H, W, C), exactly 0 in the background.

        Raises:
            InputError: another number of vertices. TypeError: neither float32 nor float64.
        """
        images = self._product(attributes)
        return images.reshape(*attributes.shape[:-2], *self._shape, attributes.shape[-1])

    def adjoint(self, images: torch.Tensor) -> torch.Tensor:
        """Bᵀ: images (..., S, H, W, C) to sums at vertices (..., N, C); the background does not count."""
        if images.shape[-4:-1] != self._shape:
            raise InputError(f"images must have shape (..., {self._shape}, C), found {tuple(images.shape)}")
        return self._product.transposed(images.reshape(*images.shape[:-4], -1, images.shape[-1]))

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> MapOperator:
        """The same operator with its mask on `device` and its matrix there in `dtype` (float32 if None)."""
        moved = object.__new__(MapOperator)
        moved._shape, moved._product = self._shape, self._product
        moved.mask = self.mask.to(device)
        self._product.placed(moved.mask.device, dtype or torch.float32)
        return moved
