"""What a ray from the eye meets, a garment or a picture of its maps; and which pixel shows which point of a garment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from render import TemplateImager

_EDGE = 1e-9  # of a barycentric coordinate: rays along an edge meet one of its faces


@dataclass(frozen=True)
class Mark:
    """A point on a garment, which stays where it is on the cloth.

    Args:
        face: row of the garment's faces.
        weights: barycentric coordinates in it, of sum 1.
    """

    face: int
    weights: tuple[float, float, float]

    def place(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """(3,) where it is on vertices (N, 3), faces (F, 3)."""
        place: np.ndarray = np.asarray(self.weights) @ vertices[faces[self.face]].astype(np.float64)
        return place


@dataclass(frozen=True, eq=False)
class Ray:
    """From the eye through the pixel of the page that was clicked.

    Args:
        origin, direction: (3,), metres, of any length.
    """

    origin: np.ndarray
    direction: np.ndarray

    def moved(self, by: np.ndarray) -> Ray:
        """The ray as seen from what has been moved by (3,) metres."""
        return Ray(self.origin - by, self.direction)


def first_hit(ray: Ray, vertices: np.ndarray, faces: np.ndarray) -> tuple[float, Mark] | None:
    """How far along a ray it meets a mesh first, from either side, and the point there; None where it passes by.

    Args:
        vertices: (N, 3). faces: (F, 3).
    """
    start, along, across = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    along, across = along - start, across - start
    direction = np.asarray(ray.direction, np.float64)
    normal = np.cross(direction, across)
    determinant = (along * normal).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        from_start = ray.origin - start
        u = (from_start * normal).sum(axis=1) / determinant
        second = np.cross(from_start, along)
        v = second @ direction / determinant
        distance = (second * across).sum(axis=1) / determinant
        inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1 + _EDGE) & (distance > 0)
    if not inside.any():
        return None
    face = int(np.argmin(np.where(inside, distance, np.inf)))
    weights = float(1 - u[face] - v[face]), float(u[face]), float(v[face])
    return float(distance[face]), Mark(face, weights)


def on_picture(
    ray: Ray, centre: np.ndarray, width: float, height: float, size: tuple[int, int]
) -> tuple[float, tuple[int, int]] | None:
    """Where a ray meets an upright picture that faces +z, and how far along the ray; None where it passes by.

    Args:
        centre: (3,) of the picture. width, height: metres. size: (rows, columns) of its pixels.

    Returns:
        The distance, and (row, column), row 0 at the top.
    """
    if ray.direction[2] == 0:
        return None
    distance = float((centre[2] - ray.origin[2]) / ray.direction[2])
    x, y, _ = ray.origin + distance * ray.direction - centre
    right, down = x / width + 0.5, 0.5 - y / height
    if distance <= 0 or not (0 <= right < 1 and 0 <= down < 1):
        return None
    return distance, (int(down * size[0]), int(right * size[1]))


class Pixels:
    """Which pixels of a template's images show which points of it.

    Args:
        imager: of the template.
    """

    def __init__(self, imager: TemplateImager) -> None:
        self._imager = imager

    def mark(self, view: int, row: int, column: int) -> Mark | None:
        """The point of the template that a pixel shows; None in the background."""
        raster = self._imager.raster
        face = int(raster.face_id[view, row, column])
        if face < 0:
            return None
        first, second, third = raster.barycentric[view, row, column].tolist()
        return Mark(face, (first, second, third))

    def pixel(self, view: int, mark: Mark) -> tuple[int, int] | None:
        """(row, column) of the pixel that shows a point of the template best; None where the view does not see it."""
        tree, reach, rows, columns = self._views[view]
        place = mark.place(self._imager.mesh.vertices, self._imager.mesh.faces)
        distance, nearest = tree.query(place)
        return (int(rows[nearest]), int(columns[nearest])) if distance <= reach else None

    @cached_property
    def _views(self) -> list[tuple[cKDTree, float, np.ndarray, np.ndarray]]:
        """For each image the points that its pixels show, how far from one of them a point is still seen, and where the
        pixels are.
        """
        raster, mesh, views = self._imager.raster, self._imager.mesh, []
        for face_id, weights in zip(raster.face_id, raster.barycentric, strict=True):
            rows, columns = np.nonzero(face_id >= 0)
            corners = mesh.vertices[mesh.faces[face_id[rows, columns]]]
            points = np.einsum("pc,pcx->px", weights[rows, columns], corners)
            tree = cKDTree(points)
            apart = tree.query(points, k=2)[0][:, 1] if len(points) > 1 else np.zeros(1)
            views.append((tree, 2 * float(np.median(apart)), rows, columns))
        return views
