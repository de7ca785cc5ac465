"""How the posed body's surface has turned, read off its images: one rotation per pixel, no skinning weights."""

from __future__ import annotations

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

CELLS = 32  # rotations along the longer side of the image; they vary slowly, pixels between are interpolated
REACH_M = 0.06  # standard deviation of the surface patch that a rotation is fitted to
SAMPLES = 7  # along each side of the window that holds the patch
POLAR_STEPS = 6  # float32 and float64 have converged then, however flat the patch
_LEAST_DETERMINANT = 1e-4  # of a matrix as large as a rotation: below, its orientation is chance


class LocalFrames:
    """Fits the rotation that carries the rest body's surface to the posed one, around each cell of a coarse grid.

    The fit is Kabsch's over the surface points around the cell (weights fall with the distance on the rest
    body, so that an arm does not turn the flank beside it in the image), with the normals as further pairs:
    points of a flat patch leave the third axis to chance.

    Args:
        body_mask: (S, H, W) bool.
        projected: (S, H, W, 3) float32, metres, the rest body that the cameras see: it decides on the patches.
        rest_positions: (K, S, H, W, 3) float32, metres, the same points in K body shapes.
        rest_normals: (K, S, H, W, 3) float32, unit.
    """

    def __init__(
        self, body_mask: Tensor, projected: Tensor, rest_positions: Tensor, rest_normals: Tensor
    ) -> None:
        height, width = self._size = (body_mask.shape[1], body_mask.shape[2])
        longer = max(height, width)
        self._grid = (max(1, round(CELLS * height / longer)), max(1, round(CELLS * width / longer)))
        index, weight = _patches(body_mask.cpu().numpy(), projected.cpu().numpy(), self._grid)
        self._index = torch.from_numpy(index).to(body_mask.device)
        weights = torch.from_numpy(weight).to(rest_positions)[..., None]
        points = rest_positions.flatten(1, 3)[:, self._index]  # (K, C, P, 3), P points in each of C patches
        self._points = weights * (points - (weights * points).sum(2, keepdim=True))
        self._normals = REACH_M**2 * weights * rest_normals.flatten(1, 3)[:, self._index]

    def __call__(self, positions: Tensor, normals: Tensor, shape: Tensor | None = None) -> Tensor:
        """Rotations of posed bodies.

        Args:
            positions: (B, S, H, W, 3) metres.
            normals: (B, S, H, W, 3) unit.
            shape: (B,) int64, which of the K shapes each is; the first if None.

        Returns:
            (B, S, H, W, 3, 3), rest to posed, everywhere in the image; between cells blended linearly, so
            slightly shorter than a rotation where neighbours differ.
        """
        views = positions.shape[1]
        # Sums over a patch of posed ⊗ rest, (B, C, 3, 3); the rest points have mean 0, so the posed mean drops out.
        covariance = self._sums(positions, chosen(self._points, shape))
        covariance += self._sums(normals, chosen(self._normals, shape))
        rotation = nearest_rotation(covariance)  # (B, S * rows * columns, 3, 3)
        grid = rotation.unflatten(1, (views, *self._grid)).flatten(0, 1).flatten(-2).movedim(-1, 1)
        smooth = functional.interpolate(grid, size=self._size, mode="bilinear", align_corners=False)
        return smooth.movedim(1, -1).unflatten(0, (-1, views)).unflatten(-1, (3, 3))

    def _sums(self, posed: Tensor, rest: Tensor) -> Tensor:
        """Images (B, S, H, W, 3), and of the patches' points (B or 1, C, P, 3) -> (B, C, 3, 3), sums of products."""
        frames, (cells, points) = len(posed), self._index.shape
        if len(rest) > 1:
            return posed.flatten(1, 3)[:, self._index].mT @ rest
        # All frames of a patch in one product: three times as fast as many of 3 x 3.
        pixels = posed.flatten(1, 3).movedim(0, 1).flatten(1)  # (S * H * W, B * 3)
        patches = pixels.index_select(0, self._index.flatten()).view(cells, points, -1)
        return (rest[0].mT @ patches).unflatten(-1, (frames, 3)).permute(2, 0, 3, 1).contiguous()


def chosen(table: Tensor, shape: Tensor | None) -> Tensor:
    """(K, ...) values of K body shapes -> those of shapes (B,), or (1, ...) where all frames are of the first."""
    return table[:1] if shape is None or len(table) == 1 else table[shape]


def nearest_rotation(matrices: Tensor) -> Tensor:
    """(..., 3, 3) -> the rotation factor of the polar decomposition, by Higham's scaled Newton iteration (1986).

    In batches about four times as fast as by singular value decomposition. Unscaled, a step only halves the inverse of
    a small singular value: the matrix of a nearly flat patch would end far from any rotation. A matrix with no positive
    determinant has no such rotation (a patch that is a line, or turned inside out): identity.
    """
    scale = matrices.square().sum((-2, -1), keepdim=True).sqrt()
    identity = torch.eye(3, dtype=matrices.dtype, device=matrices.device)
    x = matrices / torch.where(scale > 0, scale, torch.ones_like(scale)) * 3**0.5
    usable = torch.linalg.det(x)[..., None, None] > _LEAST_DETERMINANT
    x = torch.where(usable, x, identity)
    for _ in range(POLAR_STEPS):
        # Rows: x1 × x2, x2 × x0, x0 × x1.
        cofactor = torch.stack(
            [torch.linalg.cross(x[..., i - 2, :], x[..., i - 1, :], dim=-1) for i in range(3)], dim=-2
        )
        determinant = (x[..., :1, :] * cofactor[..., :1, :]).sum(-1, keepdim=True)
        inverse = cofactor / determinant  # transposed
        sizes = (matrix.square().sum((-2, -1), keepdim=True) for matrix in (inverse, x))
        balance = torch.div(*sizes) ** 0.25
        x = (balance * x + inverse / balance) / 2
    return x


def window(
    row: np.ndarray, column: np.ndarray, *, reach: np.ndarray, samples: int, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels spread over a square window around each of P pixels.

    Args:
        row, column: (P,) int.
        reach: (P,) half the window's side, pixels.
        samples: number along each side, odd, so that the pixel itself is among them.
        size: (height, width); the window stops at the image's border.

    Returns:
        rows (P, samples²), columns (P, samples²) int64, and the squared relative offsets (samples², 2) in [0, 1].
    """
    step = np.linspace(-1, 1, samples)
    grid = np.stack(np.meshgrid(step, step, indexing="ij"), axis=-1).reshape(-1, 2)
    rows = np.rint(row[:, None] + reach[:, None] * grid[:, 0]).astype(np.int64)
    columns = np.rint(column[:, None] + reach[:, None] * grid[:, 1]).astype(np.int64)
    return rows.clip(0, size[0] - 1), columns.clip(0, size[1] - 1), grid**2


def _patches(body_mask: np.ndarray, rest: np.ndarray, grid: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Flat pixel indices (C, P) int64 of each cell's surface patch, and their weights (C, P) that sum to 1.

    A cell off the body takes the patch around the nearest body pixel.
    """
    views, height, width = body_mask.shape
    # How many metres a pixel spans on the rest body: the median step between neighbours that are both
    # covered.
    both = body_mask[:, :, 1:] & body_mask[:, :, :-1]
    pixel_m = (
        float(np.median(np.linalg.norm(np.diff(rest, axis=2), axis=-1)[both])) if both.any() else REACH_M
    )
    centre_row, centre_column = (
        ((np.arange(n) + 0.5) * full / n).astype(np.int64)
        for n, full in zip(grid, (height, width), strict=True)
    )
    indices, weights = [], []
    for view in range(views):
        nearest = ndimage.distance_transform_edt(
            ~body_mask[view], return_distances=False, return_indices=True
        )
        row, column = (axis[np.ix_(centre_row, centre_column)].ravel() for axis in nearest)
        reach = np.full(len(row), 2 * REACH_M / pixel_m)
        at_row, at_column, _ = window(row, column, reach=reach, samples=SAMPLES, size=(height, width))
        centre = rest[view][row, column][:, None]
        squared = np.square(rest[view][at_row, at_column] - centre).sum(-1)
        weight = np.exp(-squared / (2 * REACH_M**2)) * body_mask[view][at_row, at_column]
        indices.append(view * height * width + at_row * width + at_column)
        weights.append(weight / weight.sum(1, keepdims=True))
    return np.concatenate(indices), np.concatenate(weights).astype(np.float32)
