"""Pictures for a report: shaded meshes, errors as colours, curves. All are (H, W, 3) uint8 RGB arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from render import Camera, Mesh, frame_cameras, rasterize, vertex_normals
from render.pictures import heat_colours, scale_bar

SKIN, CLOTH = (0.87, 0.78, 0.71), (0.36, 0.55, 0.80)
_SMOOTHING = 2  # pixels are drawn this many times as fine in each direction, and averaged
_LIGHT = np.array([0.35, 0.55, 0.76])  # from above, over the viewer's right shoulder, in camera axes
_AMBIENT, _DIFFUSE, _HIGHLIGHT = 0.42, 0.55, 0.06


@dataclass(frozen=True, eq=False)
class ShadedMesh:
    """A mesh with its colour.

    Args:
        vertices: (N, 3), metres.
        faces: (F, 3) int.
        colour: RGB in [0, 1], (3,) for all or (N, 3) for each vertex.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colour: Sequence[float] | np.ndarray = CLOTH


def picture_camera(
    vertices: np.ndarray,
    *,
    view: str = "front",
    turn_degrees: float = 20.0,
    size: tuple[int, int] = (420, 300),
) -> Camera:
    """A camera for `mesh_picture` that frames points (..., 3): give all frames of a row to see them alike.

    Args:
        vertices: what must be in the picture, metres, y up.
        view: the side it is seen from: front, back, left or right.
        turn_degrees: how far the camera then goes round to the right, which shows depth better.
        size: (height, width) in pixels.
    """
    angle = np.radians(turn_degrees)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = -np.sin(angle), np.sin(angle)
    points = np.asarray(vertices, np.float64).reshape(-1, 3) @ turn[:3, :3].T
    height, width = (_SMOOTHING * pixels for pixels in size)
    frame = Mesh(points, np.array([[0, 0, 0]]), "picture")
    (camera,) = frame_cameras(frame, views=(view,), size=(height, width), margin=0.02)
    return Camera(camera.name, camera.view @ turn, camera.projection, camera.size)


def mesh_picture(
    surfaces: Sequence[ShadedMesh], camera: Camera | None = None, *, backend: str = "auto"
) -> np.ndarray:
    """Shaded meshes on white.

    Args:
        surfaces: the meshes, such as body and garment.
        camera: from `picture_camera`; None frames the surfaces from the front.
        backend: as for `render.rasterize`.

    Returns:
        (H, W, 3) uint8.
    """
    vertices = np.concatenate([np.asarray(surface.vertices, np.float64) for surface in surfaces])
    starts = np.cumsum([0] + [len(surface.vertices) for surface in surfaces])
    faces = np.concatenate(
        [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
    )
    colours = np.concatenate(
        [np.broadcast_to(np.asarray(s.colour, np.float64), (len(s.vertices), 3)) for s in surfaces]
    )
    camera = camera or picture_camera(vertices)
    raster = rasterize(Mesh(vertices, faces, "picture"), [camera], backend=backend)
    face_id, weights, mask = raster.face_id[0], raster.barycentric[0], raster.mask[0]
    normals = vertex_normals(torch.from_numpy(vertices), torch.from_numpy(faces.astype(np.int64))).numpy()
    corners, weights = faces[face_id[mask]], weights[mask][..., None]
    normal = (normals[corners] * weights).sum(axis=1) @ camera.view[:3, :3].T
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    normal *= np.where(normal[:, 2:] < 0, -1, 1)  # the inside of cloth is lit as its outside
    picture = np.ones((*mask.shape, 3))
    picture[mask] = _shade((colours[corners] * weights).sum(axis=1), normal)
    height, width = camera.size
    small = cv2.resize(picture, (width // _SMOOTHING, height // _SMOOTHING), interpolation=cv2.INTER_AREA)
    return (small.clip(0, 1) * 255).round().astype(np.uint8)


def error_picture(
    garment: ShadedMesh,
    distance_mm: np.ndarray,
    *,
    limit_mm: float,
    body: ShadedMesh | None = None,
    camera: Camera | None = None,
    backend: str = "auto",
) -> np.ndarray:
    """A garment coloured by its error, with the colour bar below.

    Args:
        garment: the predicted mesh; its own colour is not used.
        distance_mm: (N,) distance of each vertex to the truth, millimetres.
        limit_mm: the value of the brightest colour; larger ones get it too.
        body: drawn with it, in its own colour.
        camera, backend: as for `mesh_picture`.

    Returns:
        (H + 44, W, 3) uint8.
    """
    coloured = ShadedMesh(
        garment.vertices, garment.faces, heat_colours(np.asarray(distance_mm) / limit_mm) / 255
    )
    picture = mesh_picture([coloured] if body is None else [body, coloured], camera, backend=backend)
    return np.concatenate([picture, scale_bar(picture.shape[1], limit_mm, "mm")])


def curve_picture(
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    *,
    title: str = "",
    x_label: str = "step",
    y_label: str = "loss",
    logarithmic: bool = True,
    size: tuple[int, int] = (360, 640),
) -> np.ndarray:
    """Curves such as losses over steps.

    Args:
        curves: by name, its x and its y values.
        title, x_label, y_label: texts.
        logarithmic: whether y is drawn on a logarithmic axis.
        size: (height, width) in pixels.

    Returns:
        (H, W, 3) uint8.
    """
    figure = Figure(figsize=(size[1] / 100, size[0] / 100), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    for name, (x, y) in curves.items():
        axes.plot(x, y, label=name, linewidth=1.5, marker="o" if len(x) < 25 else "", markersize=3)
    if logarithmic and any(value > 0 for _, y in curves.values() for value in y):
        axes.set_yscale("log")
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    if curves:
        axes.legend(frameon=False)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _shade(colour: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(P, 3) colours and unit normals in camera axes -> (P, 3) lit colours: Lambert and a faint highlight."""
    towards = normal @ (_LIGHT / np.linalg.norm(_LIGHT))
    reflected = 2 * towards * normal[:, 2] - _LIGHT[2] / np.linalg.norm(_LIGHT)
    light = _AMBIENT + _DIFFUSE * np.clip(towards, 0, 1) + 0.12 * np.clip(normal[:, 2], 0, 1)
    highlight = _HIGHLIGHT * np.clip(reflected, 0, 1) ** 12
    return colour * light[:, None] + highlight[:, None]
