"""Perspective cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.errors import InputError
from render.limits import MAX_LAYERS

_LARGEST = 1e6  # in a camera's matrices: metres, and pixels a tangent


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera.

    Args:
        name: what messages and pictures call the view.
        view: (4, 4) float64, world to camera coordinates in metres; the camera looks along its -z, y up.
        projection: (4, 4) float64, camera to clip coordinates, OpenGL's perspective form (last row 0 0 -1 0).
            Its near plane is kept by the rasteriser; its far plane is for other renderers, nothing is clipped at it.
        size: (height, width) of the image in pixels.
        layer: which surface along each ray the image shows: 0 the nearest, 1 the second, and so on; both sides
            of every face are surfaces.

    Raises:
        InputError: wrong shapes, values that are not finite, no perspective projection, an empty image, or a
            layer below 0.
    """

    name: str
    view: NDArray[np.float64]
    projection: NDArray[np.float64]
    size: tuple[int, int]
    layer: int = 0

    def __post_init__(self) -> None:
        for field in ("view", "projection"):
            matrix = np.asarray(getattr(self, field), np.float64)
            if matrix.shape != (4, 4) or not (np.abs(matrix) <= _LARGEST).all():
                raise InputError(
                    f"camera '{self.name}': {field} must be a finite (4, 4) matrix of values up to {_LARGEST:g}, found "
                    f"{matrix.shape}"
                )
            object.__setattr__(self, field, matrix)
        if not np.allclose(self.projection[3], (0, 0, -1, 0)) or not np.allclose(self.projection[:2, 3], 0):
            raise InputError(
                f"camera '{self.name}': projection must be perspective, its last row 0 0 -1 0, its offset 0 "
                f"in x and y; found {self.projection.tolist()}"
            )
        object.__setattr__(self, "size", check_size(self.size))
        if int(self.layer) != self.layer or not 0 <= self.layer < MAX_LAYERS:
            raise InputError(
                f"camera '{self.name}': layer must be a whole number from 0 to {MAX_LAYERS - 1}, found {self.layer}"
            )

    @property
    def near(self) -> float:
        """Distance of the near plane in metres."""
        return float(self.projection[2, 3] / (self.projection[2, 2] - 1))

    def project(self, points: np.ndarray) -> NDArray[np.float64]:
        """Where points fall in the image.

        Args:
            points: (..., 3), metres, world coordinates.

        Returns:
            (..., 3) float64: x and y in pixels (y downwards; pixel (row i, column j) has its centre at x = j + 0.5,
            y = i + 0.5) and the depth in metres along the viewing axis. Not cut at the image's border. x and y are
            NaN for points that are not in front of the camera (depth <= 0).
        """
        return self.to_pixels(self.to_camera(points))

    def to_camera(self, points: np.ndarray) -> NDArray[np.float64]:
        """World points (..., 3) in camera coordinates, float64, metres."""
        return _transform(self.view[:3], np.asarray(points, np.float64))

    def to_pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `project`, for points (..., 3) float64 in camera coordinates."""
        clip = _transform(self.projection, points)
        depth = clip[..., 3]
        divisor = np.where(depth > 0, depth, np.nan)
        height, width = self.size
        x = (1 + clip[..., 0] / divisor) * (width / 2)
        y = (1 - clip[..., 1] / divisor) * (height / 2)  # the image's rows run down, OpenGL's y runs up
        return np.stack([x, y, depth], axis=-1)


def _transform(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 4) matrix times (..., 3) points with a 1 -> (..., K).

    Term by term: matrix products round by where in an array a point stands, and then faces would not meet.
    """
    x, y, z = (points[..., axis, None] for axis in range(3))
    return x * matrix[:, 0] + y * matrix[:, 1] + z * matrix[:, 2] + matrix[:, 3]


def check_size(size: Sequence[int]) -> tuple[int, int]:
    """Return (height, width) as ints; raise InputError unless they are two whole numbers of at least 1."""
    if len(size) != 2 or any(int(extent) != extent or extent < 1 for extent in size):
        raise InputError(f"size must be (height, width) in pixels, each at least 1, found {tuple(size)}")
    return int(size[0]), int(size[1])


def perspective(tangent: np.ndarray, near: float, far: float) -> np.ndarray:
    """OpenGL's (4, 4) projection from the tangents of half the view across and up; limits in metres."""
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 1 / np.asarray(tangent)
    projection[2, 2:] = -(far + near) / (far - near), -2 * far * near / (far - near)
    projection[3, 2] = -1
    return projection
