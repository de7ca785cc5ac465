"""A sparse matrix over the vertices, factorised once and solved for many frames."""

from __future__ import annotations

import cholespy
import numpy as np
import scipy.sparse
import torch

_COLUMNS = 126  # right-hand sides at once: whole vertices, and no more than CUDA takes


class Factor:
    """The Cholesky factor of a sparse symmetric positive definite matrix, the same for all three axes.

    Args:
        matrix: (N, N).
        device, dtype: of the right-hand sides; float32 or float64.
    """

    def __init__(self, matrix: scipy.sparse.spmatrix, device: torch.device, dtype: torch.dtype) -> None:
        entries = matrix.tocoo()
        solver = cholespy.CholeskySolverD if dtype == torch.float64 else cholespy.CholeskySolverF
        rows, columns = (
            torch.from_numpy(index.astype(np.int32)).to(device) for index in (entries.row, entries.col)
        )
        values = torch.from_numpy(entries.data.astype(np.float64)).to(device)
        self._count = matrix.shape[0]
        self._solver = solver(matrix.shape[0], rows, columns, values, cholespy.MatrixType.COO)

    def solve(self, right: torch.Tensor) -> torch.Tensor:
        """(T, N, 3) to (T, N, 3), device and dtype of the factor; ValueError for another N."""
        frames, count, _ = right.shape
        if count != self._count:  # the library would read beyond the end of memory
            raise ValueError(f"a factor of {self._count} vertices solves for as many, found {count}")
        if not frames:  # without columns, it would end the process
            return torch.empty_like(right)
        parts = []
        for part in right.transpose(0, 1).reshape(count, 3 * frames).split(_COLUMNS, dim=1):
            columns = part.contiguous()
            parts.append(torch.empty_like(columns))
            self._solver.solve(columns, parts[-1])
        solution = parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)
        return solution.reshape(count, frames, 3).transpose(0, 1).contiguous()
