"""The garment's texture space: where vertices lie in it, and which part of the garment each of its pixels shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imgtransfer.data.clip_parts import Template
from render.maps.layout import atlas


@dataclass(frozen=True, eq=False)
class TextureSpace:
    """A garment laid out in the unit square; u goes with columns, v with rows.

    Args:
        uvs: (N, 2) float32, where each vertex is read; at a seam one of its places.
        pixels: (P,) int64, row × size + column of pixels whose centre the garment covers.
        corners: (P, 3) int64, the vertices of the triangle there. weights: (P, 3) float32 of them, of sum 1.
    """

    uvs: np.ndarray
    pixels: np.ndarray
    corners: np.ndarray
    weights: np.ndarray


def texture_space(template: Template, size: int) -> TextureSpace:
    """The layout of a template: its texture coordinates stretched to the unit square, or charts made by xatlas.

    Where triangles overlap in the texture, the last one counts.

    Raises:
        InputError: a template without texture coordinates, and no xatlas.
    """
    uvs, uv_faces, corners = _coordinates(template)
    low, high = uvs.min(0), uvs.max(0)
    placed = (uvs - low) / np.maximum(high - low, 1e-12)
    of_vertex = np.full((len(template.vertices), 2), 0.5)
    of_vertex[corners.ravel()] = placed[uv_faces.ravel()]
    pixels, triangle, weights = covered(placed[uv_faces] * size, size)
    return TextureSpace(of_vertex.astype(np.float32), pixels, corners[triangle], weights.astype(np.float32))


def covered(triangles: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels whose centre triangles cover.

    Args:
        triangles: (F, 3, 2), corners in pixels, x before y; pixel (r, c) has its centre at (c + 0.5, r + 0.5).

    Returns:
        pixels (P,) int64 in rising order, the triangle (P,) int64 and its corners' weights (P, 3) float64 of each.
    """
    owner = np.full(size * size, -1)
    weights = np.zeros((size * size, 3))
    for index, corners in enumerate(triangles):
        low = np.clip(np.ceil(corners.min(0) - 0.5), 0, size).astype(int)
        high = np.clip(np.floor(corners.max(0) - 0.5) + 1, 0, size).astype(int)
        (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
        area = a * d - b * c
        if area == 0 or (high <= low).any():
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        px, py = x + 0.5 - corners[0, 0], y + 0.5 - corners[0, 1]
        second, third = (px * d - py * c) / area, (py * a - px * b) / area
        inside = (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)
        pixel = (y * size + x)[inside]
        owner[pixel] = index
        weights[pixel] = np.stack([1 - second - third, second, third], -1)[inside]
    pixels = np.flatnonzero(owner >= 0)
    return pixels, owner[pixels], weights[pixels]


def _coordinates(template: Template) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates (U, 2), their indices (F, 3), and the template's vertices (F, 3) at the same corners."""
    surface = template.surface
    if surface is not None and surface.uvs is not None and surface.uv_faces is not None:
        known = bool((surface.uv_faces >= 0).all())
        if known and len(surface.uv_faces):
            return surface.uvs.astype(np.float64), surface.uv_faces, surface.vertices[surface.faces]
    purpose = "motion_guided, for a template without texture coordinates,"
    uvs, faces, origin = atlas(template.vertices, template.faces, purpose)
    return uvs, faces, origin[faces]
