"""A sparse system that is factorised once, and solved for all frames at every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse
import torch
from scipy.sparse.linalg import splu

from fusion.solvers.recorder import Recorder, frames_last
from render.mesh.factor import Factor


class System:
    """A sparse symmetric positive definite matrix, the same for all frames and axes.

    On the CPU it is solved for several frames at once by the vector units, which takes a fifth of the time of
    `Factor`; on CUDA by `Factor`.

    Args:
        matrix: (N, N).
        device, dtype: of the right-hand sides; float32 or float64.

    Raises:
        ValueError: a matrix that is not positive definite.
    """

    def __init__(self, matrix: scipy.sparse.spmatrix, device: torch.device, dtype: torch.dtype) -> None:
        self._factor = Factor(matrix, device, dtype) if device.type != "cpu" else None
        if self._factor is not None:
            return
        # Without pivoting, so that U is D Lᵀ.
        options = {"SymmetricMode": True}
        found = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        if (found.perm_r != found.perm_c).any() or (found.U.diagonal() <= 0).any():
            raise ValueError("the matrix is not positive definite")
        self._order = np.argsort(found.perm_c).astype(np.int32)  # of the vertices, by row
        lower, inverse = scipy.sparse.tril(found.L, -1), torch.from_numpy(1 / found.U.diagonal())
        by_row, by_column = lower.tocsr(), lower.tocsc()
        by_row.sort_indices()
        by_column.sort_indices()
        self._rows, self._columns = (
            (part.indptr, part.indices, torch.from_numpy(part.data)) for part in (by_row, by_column)
        )
        self._inverse = inverse

    def solver(self, right: torch.Tensor, solution: torch.Tensor, busy: torch.Tensor) -> Callable[[], None]:
        """What solves for `right` as it is when called.

        Args:
            right, solution: (T, N, 3) of `frames_last`; the second is filled.
            busy: (G,) int32, groups of frames that take part; others may keep their solution.
        """
        factor = self._factor
        if factor is not None:

            def solve() -> None:
                solution.copy_(factor.solve(right))

            return solve
        record = Recorder(right, busy)
        work = frames_last(*right.shape, like=right)

        def triangle(part: tuple[np.ndarray, np.ndarray, torch.Tensor]) -> list[Any]:
            start, indices, values = part
            return [record.ints(start), record.ints(indices), record.reals(values)]

        arguments = [*triangle(self._rows), record.reals(self._inverse), *triangle(self._columns)]
        vectors = (record.frames(tensor) for tensor in (right, work, solution))
        record("substitute", (), len(self._order), record.ints(self._order), *arguments, *vectors)
        return record.run
