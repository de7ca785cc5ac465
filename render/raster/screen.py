"""Faces as a camera sees them: what both rasterisers and the visibility test start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.cameras import Camera
from render.mesh.mesh import Mesh

_LEAST_AREA = 1e-9  # pixels squared; a face seen edge-on covers no pixel and has no depth plane


@dataclass(frozen=True, eq=False)
class ScreenFaces:
    """Faces in front of a camera, in pixels.

    Args:
        ids: (K,) int64, ascending, index of each in the mesh's faces. Edge-on faces and those behind the near
            plane are left out; of a face that reaches through it one or two triangles remain, with one id.
        corners: (K, 3, 2) float64, pixels, y downwards.
        plane: (K, 3) float64, the reciprocal depth (1/m) over the image, which perspective makes affine:
            plane[0] + plane[1] (x - x0) + plane[2] (y - y0) with (x0, y0) the first corner.
        nearest: (K,) float64, metres, the depth of the nearest corner.
    """

    ids: NDArray[np.int64]
    corners: NDArray[np.float64]
    plane: NDArray[np.float64]
    nearest: NDArray[np.float64]

    def reciprocal_depth(self, index: np.ndarray, points: np.ndarray) -> NDArray[np.float64]:
        """1 / depth of faces `index` (...,) (into `ids`) at image points (..., 2) in pixels."""
        offset = points - self.corners[index, 0]
        plane = self.plane[index]
        value: NDArray[np.float64] = plane[..., 0] + (plane[..., 1:] * offset).sum(axis=-1)
        return value


def screen_faces(mesh: Mesh, camera: Camera) -> ScreenFaces:
    """Project the faces of a mesh, as far as they lie before the camera's near plane."""
    # Corners in the order of their indices: copies of a face, turned or not, then get the very same plane, and
    # neighbours that the near plane cuts get the very same cut.
    ids, corners = before_plane(camera.to_camera(mesh.vertices)[np.sort(mesh.faces, axis=1)], camera.near)
    triangles = camera.to_pixels(corners)
    edge_1, edge_2 = triangles[:, 1, :2] - triangles[:, 0, :2], triangles[:, 2, :2] - triangles[:, 0, :2]
    area = edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0]
    kept = np.abs(area) > _LEAST_AREA
    ids, triangles, edge_1, edge_2, area = ids[kept], triangles[kept], edge_1[kept], edge_2[kept], area[kept]
    value = 1 / triangles[:, :, 2]
    rise_1, rise_2 = value[:, 1] - value[:, 0], value[:, 2] - value[:, 0]
    slope_x = (rise_1 * edge_2[:, 1] - rise_2 * edge_1[:, 1]) / area
    slope_y = (rise_2 * edge_1[:, 0] - rise_1 * edge_2[:, 0]) / area
    plane = np.stack([value[:, 0], slope_x, slope_y], axis=1)
    return ScreenFaces(ids, triangles[:, :, :2], plane, triangles[:, :, 2].min(axis=1))


def before_plane(corners: NDArray[np.float64], near: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The parts of triangles that lie at a depth of at least `near`.

    Args:
        corners: (F, 3, 3) float64, metres, camera coordinates (the camera looks along -z).
        near: metres.

    Returns:
        (K,) int64, ascending, which triangle each part belongs to, and the parts' corners (K, 3, 3). Whole
        triangles keep their corners; of a triangle with one corner in front a smaller one remains, of one with
        two a quadrilateral, as two triangles.
    """
    front = -corners[..., 2] >= near
    count = front.sum(axis=1)
    whole, one, two = (np.flatnonzero(count == number) for number in (3, 1, 2))
    # The corner that is alone on its side, and the two others in the order of their indices.
    alone = np.concatenate([front[one], ~front[two]]).argmax(axis=1)
    others = np.array([[1, 2], [0, 2], [0, 1]])[alone]
    cut = corners[np.concatenate([one, two])]
    row = np.arange(len(cut))
    tip, left, right = cut[row, alone], cut[row, others[:, 0]], cut[row, others[:, 1]]
    on_left = _cut(tip, left, alone < others[:, 0], near)
    on_right = _cut(tip, right, alone < others[:, 1], near)
    tips, rest = slice(None, len(one)), slice(len(one), None)
    parts = np.concatenate(
        [
            corners[whole],
            np.stack([tip, on_left, on_right], axis=1)[tips],
            np.stack([left, right, on_left], axis=1)[rest],
            np.stack([right, on_left, on_right], axis=1)[rest],
        ]
    )
    owner = np.concatenate([whole, one, two, two])
    order = np.argsort(owner, kind="stable")
    return owner[order], parts[order]


def _cut(
    tip: NDArray[np.float64], end: NDArray[np.float64], tip_first: NDArray[np.bool_], near: float
) -> NDArray[np.float64]:
    """(K, 3): where edges meet the near plane; reckoned from the corner of lower index on, whoever asks."""
    low, high = np.where(tip_first[:, None], tip, end), np.where(tip_first[:, None], end, tip)
    fraction = (-near - low[:, 2]) / (high[:, 2] - low[:, 2])
    point: NDArray[np.float64] = low + (high - low) * fraction[:, None]
    point[:, 2] = -near
    return point


def expand(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts (K,): the owner k and the running number 0..counts[k]-1 of each of counts.sum() items."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
