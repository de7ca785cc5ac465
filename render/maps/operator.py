"""The interpolation B: from values at vertices to images, and back by its adjoint."""

from __future__ import annotations

import numpy as np
import torch

from render.errors import InputError
from render.mesh.sparse import SparseProduct
from render.raster.raster import Raster


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
        return self._product.transposed(images.flatten(-4, -2))

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> MapOperator:
        """The same operator with its mask on `device` and its matrix there in `dtype` (float32 if None)."""
        moved = object.__new__(MapOperator)
        moved._shape, moved._product = self._shape, self._product
        moved.mask = self.mask.to(device)
        self._product.placed(moved.mask.device, dtype or torch.float32)
        return moved
