"""Rasterisation: which face, where in it, and how far, for every pixel of every view."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from render.cameras import Camera
from render.errors import InputError
from render.limits import MAX_LENGTH
from render.memory import check_memory
from render.mesh.mesh import Mesh
from render.raster.context import GL_BACKENDS, GLContext, GLUnavailableError, open_context
from render.raster.gl import gl_face_ids
from render.raster.reference import reference_face_ids
from render.raster.screen import ScreenFaces, screen_faces

BACKENDS = ("auto", *GL_BACKENDS, "numpy")
_FaceIds = Callable[[ScreenFaces, tuple[int, int], int], np.ndarray]


@dataclass(frozen=True, eq=False)
class Raster:
    """What S images of H × W pixels show of one mesh, each the surface that its camera's layer names.

    Args:
        face_id: (S, H, W) int32, -1 in the background.
        barycentric: (S, H, W, 3) float64, weights of the face's three vertices at the pixel's centre, on the
            surface (perspective is accounted for); non-negative with sum 1, all 0 in the background.
        depth: (S, H, W) float32, metres along the viewing axis, 0 in the background.
        backend: what drew it: egl, osmesa or numpy.
    """

    face_id: np.ndarray
    barycentric: np.ndarray
    depth: np.ndarray
    backend: str

    @property
    def mask(self) -> np.ndarray:
        """(S, H, W) bool, true where a pixel sees the mesh."""
        return self.face_id >= 0

    def images(self, chosen: np.ndarray) -> Raster:
        """The raster of some of the images only; (S,) bool."""
        return Raster(self.face_id[chosen], self.barycentric[chosen], self.depth[chosen], self.backend)


_BYTES_A_PIXEL = (
    100  # of an image while it is drawn: face, weights and depth, and what they are computed from
)


def rasterize(mesh: Mesh, cameras: Sequence[Camera], *, backend: str = "auto") -> Raster:
    """Rasterise a mesh; both sides of every face count, as far as they lie before the camera's near plane.

    Cameras that differ in their layer only share one drawing.

    Face ids come from the backend. Barycentrics and depth are then computed from them in float64, so they do
    not depend on the backend.

    Args:
        mesh: what to draw, world coordinates.
        cameras: one or more, all of the same size.
        backend: "egl", "osmesa", "numpy" (exact, slower), or "auto": the first of these that works, with a
            warning if it is the last.

    Raises:
        InputError: no camera, cameras of different or impossible sizes or of more pixels than there is memory for, an
            unknown or unavailable backend, or a mesh that a camera of layer 0 does not see at all.
    """
    if not cameras or len({camera.size for camera in cameras}) != 1:
        raise InputError(
            "one or more cameras of one size are needed, found (height, width) "
            f"{[camera.size for camera in cameras]}"
        )
    if not all(1 <= length <= MAX_LENGTH for length in cameras[0].size):
        raise InputError(f"images of 1 to {MAX_LENGTH} pixels a side can be drawn, found {cameras[0].size}")
    height, width = cameras[0].size
    check_memory(
        len(cameras) * height * width * _BYTES_A_PIXEL, f"{len(cameras)} images of {height} x {width} pixels"
    )
    with drawing_context(backend) as context:
        face_ids = reference_face_ids if context is None else partial(gl_face_ids, context)
        drawn = _draw(mesh, cameras, face_ids)
    for camera, ids in zip(cameras, drawn, strict=True):
        if camera.layer == 0 and (ids < 0).all():
            raise InputError(
                f"{mesh.source}: garment outside the view: camera '{camera.name}' sees none of it; frame the "
                "cameras on this mesh, in metres and facing +z"
            )
    places = [surface_points(mesh, camera, ids) for camera, ids in zip(cameras, drawn, strict=True)]
    barycentric = np.stack([place[0] for place in places])
    depth = np.stack([place[1] for place in places]).astype(np.float32)
    return Raster(np.stack(drawn), barycentric, depth, "numpy" if context is None else context.backend)


def _draw(mesh: Mesh, cameras: Sequence[Camera], face_ids: _FaceIds) -> list[np.ndarray]:
    """(H, W) face ids of each camera; those that differ in their layer only are drawn together."""
    places: dict[tuple[bytes, bytes], list[int]] = {}
    for image, camera in enumerate(cameras):
        places.setdefault((camera.view.tobytes(), camera.projection.tobytes()), []).append(image)
    drawn = [np.empty(0)] * len(cameras)
    for images in places.values():
        camera = cameras[images[0]]
        layers = face_ids(screen_faces(mesh, camera), camera.size, 1 + max(cameras[i].layer for i in images))
        for image in images:
            drawn[image] = layers[cameras[image].layer]
    return drawn


def surface_points(mesh: Mesh, camera: Camera, face_id: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the ray through each pixel's centre meets the pixel's face.

    Hardware snaps corners, so a centre within 1/100 pixel of an edge may lie just outside its face: weights
    are cut at 0 and rescaled to sum 1, which is the nearest point that is on the face to that accuracy.

    Args:
        mesh: (N, 3) vertices and faces.
        camera: where it is seen from.
        face_id: (H, W) integer, -1 in the background.

    Returns:
        Barycentric weights (H, W, 3) and depth in metres (H, W), both float64 and 0 in the background.
    """
    rows, columns = np.nonzero(face_id >= 0)
    height, width = camera.size
    device = np.stack([(columns + 0.5) * 2 / width - 1, 1 - (rows + 0.5) * 2 / height], axis=1)
    # Ray through the pixel in camera coordinates, at depth 1: solve projection[:2, :3] · (x, y, -1) = device.
    slopes = np.linalg.solve(camera.projection[:2, :2], (device + camera.projection[:2, 2]).T).T
    ray = np.concatenate([slopes, -np.ones((len(slopes), 1))], axis=1)
    corners = camera.to_camera(mesh.vertices)[mesh.faces[face_id[rows, columns]]]  # (P, 3 corners, 3)
    # ray ∝ Σ weight · corner; by Cramer's rule each weight is a determinant with the ray in the corner's place.
    following, last = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    weights = np.einsum("pi,pki->pk", ray, np.cross(following, last))
    total = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, total, out=np.full_like(weights, 1 / 3), where=total != 0).clip(min=0)
    weights /= weights.sum(axis=1, keepdims=True)
    barycentric, depth = np.zeros((height, width, 3)), np.zeros((height, width))
    barycentric[rows, columns] = weights
    depth[rows, columns] = -(weights * corners[:, :, 2]).sum(axis=1)
    return barycentric, depth


@contextmanager
def drawing_context(backend: str) -> Iterator[GLContext | None]:
    """The open context of a backend inside the `with` block; None where NumPy draws.

    Args:
        backend: as for `rasterize`.

    Raises:
        InputError: an unknown or unavailable backend.
    """
    if backend not in BACKENDS:
        raise InputError(f"backend must be one of {', '.join(BACKENDS)}; found '{backend}'")
    failures = []
    with ExitStack() as stack:
        for name in GL_BACKENDS if backend == "auto" else (backend,):
            if name == "numpy":
                break
            try:
                context = stack.enter_context(open_context(name))
            except GLUnavailableError as error:
                failures.append(error)
                continue
            yield context
            return
    if backend in GL_BACKENDS:
        raise InputError(f"no GL from '{failures[0]}'; {failures[0].remedy}")
    if failures:
        warnings.warn(
            f"no OpenGL ({'; '.join(map(str, failures))}): the slow NumPy rasteriser draws instead. "
            f"To mend this {failures[0].remedy}",
            stacklevel=4,
        )
    yield None
