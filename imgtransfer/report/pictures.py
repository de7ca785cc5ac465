"""Pictures for a report: shaded meshes, errors as colours, curves. All are (H, W, 3) uint8 RGB arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from imgtransfer.report.shading import Surface, draw_lit, lit
from render import Camera, Mesh, frame_cameras, rasterize, vertex_normals
from render.pictures import heat_colours, scale_bar
from render.raster import GLContext, drawing_context

SKIN, CLOTH = (0.87, 0.78, 0.71), (0.36, 0.55, 0.80)
_SMOOTHING = 2  # pixels are drawn this many times as fine in each direction, and averaged


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
    camera = camera or picture_camera(np.concatenate([surface.vertices for surface in surfaces]))
    (picture,) = mesh_pictures([surfaces], camera, backend=backend)
    return picture


def mesh_pictures(
    scenes: Iterable[Sequence[ShadedMesh]], camera: Camera, *, backend: str = "auto"
) -> list[np.ndarray]:
    """A picture of each scene, as `mesh_picture` draws it; many at once take much less time.

    Args:
        scenes: of each, the meshes in it. camera: from `picture_camera`.
        backend: as for `render.rasterize`.

    Returns:
        (H, W, 3) uint8 each.
    """
    height, width = (pixels // _SMOOTHING for pixels in camera.size)
    with drawing_context(backend) as context:
        return [
            cv2.resize(
                _fine_picture(_joined(surfaces), camera, context),
                (width, height),
                interpolation=cv2.INTER_AREA,
            )
            for surfaces in scenes
        ]


def _joined(surfaces: Sequence[ShadedMesh]) -> Surface:
    """All meshes of a scene as one, each with the normals it has by itself."""
    vertices = np.concatenate([np.asarray(surface.vertices, np.float64) for surface in surfaces])
    starts = np.cumsum([0] + [len(surface.vertices) for surface in surfaces])
    faces = np.concatenate(
        [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
    )
    colours = np.concatenate(
        [np.broadcast_to(np.asarray(s.colour, np.float64), (len(s.vertices), 3)) for s in surfaces]
    )
    normals = vertex_normals(torch.from_numpy(vertices), torch.from_numpy(faces.astype(np.int64))).numpy()
    return Surface(vertices, faces, normals, colours)


def _fine_picture(surface: Surface, camera: Camera, context: GLContext | None) -> np.ndarray:
    """(H, W, 3) uint8 in the camera's own size; without a context NumPy draws."""
    if context is not None:
        return draw_lit(context, surface, camera)
    raster = rasterize(Mesh(surface.vertices, surface.faces, "picture"), [camera], backend="numpy")
    face_id, weights, mask = raster.face_id[0], raster.barycentric[0], raster.mask[0]
    corners, weights = surface.faces[face_id[mask]], weights[mask][..., None]
    normal = (surface.normals[corners] * weights).sum(axis=1) @ camera.view[:3, :3].T
    picture = np.ones((*mask.shape, 3))
    picture[mask] = lit((surface.colours[corners] * weights).sum(axis=1), normal)
    return (picture.clip(0, 1) * 255).round().astype(np.uint8)


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
    return with_scale(picture, limit_mm=limit_mm)


def with_scale(picture: np.ndarray, *, limit_mm: float) -> np.ndarray:
    """A picture (H, W, 3) with the colour bar of errors up to a limit below it: (H + 44, W, 3) uint8."""
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
