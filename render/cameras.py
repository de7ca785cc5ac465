"""Perspective cameras, and their framing on a garment template."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from render.errors import InputError
from render.limits import MAX_LAYERS
from render.mesh.mesh import Mesh
from render.views import View, ViewsSpec, parse_views

_LARGEST = 1e6  # in a camera's matrices: metres, and pixels a tangent


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera.

    Args:
        name: what messages and pictures call the view.
        view: (4, 4) float64, world to camera coordinates in metres; the camera looks along its -z, y up.
        projection: (4, 4) float64, camera to clip coordinates, OpenGL's perspective form (last row 0 0 -1 0).
            Its near plane is kept by the rasteriser, its far plane is for other renderers: nothing is clipped
                at it.
        size: (height, width) of the image in pixels.
        layer: which surface along each ray the image shows: 0 the nearest, 1 the second, and so on; both sides
            of every face are surfaces.

    Raises:
        InputError: wrong shapes, values that are not finite, no perspective projection, an empty image, or a
            layer below 0.
    """

    name: str
    view: np.ndarray
    projection: np.ndarray
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

    def project(self, points: np.ndarray) -> np.ndarray:
        """Where points fall in the image.

        Args:
            points: (..., 3), metres, world coordinates.

        Returns:
            (..., 3) float64: x and y in pixels (pixel (row i, column j) has its centre at x = j + 0.5, y = i
            + 0.5, y downwards) and the depth in metres along the viewing axis. Not cut at the image's border.
            x and y are NaN for points that are not in front of the camera (depth <= 0).
        """
        return self.to_pixels(self.to_camera(points))

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) in camera coordinates, float64, metres."""
        return _transform(self.view[:3], np.asarray(points, np.float64))

    def to_pixels(self, seen: np.ndarray) -> np.ndarray:
        """As `project`, for points (..., 3) float64 in camera coordinates."""
        clip = _transform(self.projection, seen)
        depth = clip[..., 3]
        divisor = np.where(depth > 0, depth, np.nan)
        height, width = self.size
        x = (1 + clip[..., 0] / divisor) * (width / 2)
        y = (1 - clip[..., 1] / divisor) * (height / 2)  # the image's rows run down, OpenGL's y runs up
        return np.stack([x, y, depth], axis=-1)


def _transform(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
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


def frame_cameras(
    template: Mesh,
    *,
    views: ViewsSpec = ("front", "back"),
    size: tuple[int, int] = (256, 256),
    fov_degrees: float = 15.0,
    margin: float = 0.05,
    layers: int = 1,
) -> tuple[Camera, ...]:
    """Cameras that look at the middle of the template from the named sides, each as near as its vertices allow.

    The views of section 3.1 of the paper ("perspective camera of known transformation matrix").

    Args:
        template: the garment at rest, metres, facing +z.
        views: see `render.views.parse_views`: sides, "45/20", "four", "ring:8". Elevations that it leaves open
            are chosen for the template, the same for any image size.
        size: (height, width) of the images.
        fov_degrees: field of view over the image's shorter side; pixels are square. A narrow one stands farther
            away and sees more of the flanks (the public T-shirt: 93.8 % of the vertices at 30, 95.1 % at 15).
        margin: share of the image's height and width that stays free at each border.
        layers: how many surfaces deep each view is imaged.

    Returns:
        For each view in the order given one camera a layer, named "front", "front/1", "front/2" and so on.

    Raises:
        InputError: unknown or repeated views, none at all, or layers, a size, field of view or margin that make
            no image.
    """
    size = check_size(size)
    if not 1 <= fov_degrees <= 120 or not 0 <= margin < 0.5:
        raise InputError(
            f"the field of view must be 1 to 120 degrees and the margin 0 to below 0.5; "
            f"found {fov_degrees} and {margin}"
        )
    if int(layers) != layers or not 1 <= layers <= MAX_LAYERS:
        raise InputError(f"layers must be a whole number from 1 to {MAX_LAYERS}, found {layers}")
    if np.ptp(template.vertices, axis=0).max() == 0:
        raise InputError(f"{template.source}: all vertices are at one point, there is nothing to look at")
    tangent, parsed = math.tan(math.radians(fov_degrees) / 2), parse_views(views)
    if any(view.elevation is None for view in parsed):
        from render.framing import choose_elevations  # noqa: PLC0415 - it needs cameras itself

        parsed = choose_elevations(
            template, parsed, lambda view: _frame(template, view, (256, 256), tangent, margin)
        )
    cameras = []
    for view in parsed:
        camera = _frame(template, view, size, tangent, margin)
        cameras += [camera, *(replace(camera, name=f"{camera.name}/{k}", layer=k) for k in range(1, layers))]
    return tuple(cameras)


def _frame(template: Mesh, view: View, size: tuple[int, int], half_tangent: float, margin: float) -> Camera:
    """The camera on one side that is as near as the vertices allow; the tangent is of the shorter side's half."""
    tangent = half_tangent / min(size) * np.array([size[1], size[0]])
    low, high = template.vertices.min(axis=0), template.vertices.max(axis=0)
    rotation = view.rotation()
    offset = (template.vertices - (low + high) / 2) @ rotation.T  # right, up, towards the camera
    front = offset[:, 2].max()
    # The vertex that comes nearest to a margin just touches it; a needle that points at the camera keeps clear.
    fit = offset[:, 2] + (np.abs(offset[:, :2]) / (tangent * (1 - 2 * margin))).max(axis=1)
    distance = max(fit.max(), front + 0.05 * (high - low).max())
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ ((low + high) / 2 + distance * rotation[2])
    # Wide limits: the body, larger than the garment, is imaged with the same cameras.
    near = min(distance / 20, (distance - front) / 2)
    return Camera(view.name, matrix, perspective(tangent, near=near, far=distance * 4), size)


def perspective(tangent: np.ndarray, near: float, far: float) -> np.ndarray:
    """OpenGL's (4, 4) projection from the tangents of half the view across and up; limits in metres."""
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 1 / np.asarray(tangent)
    projection[2, 2:] = -(far + near) / (far - near), -2 * far * near / (far - near)
    projection[3, 2] = -1
    return projection
