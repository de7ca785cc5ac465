"""Sheets about maps: what the views see of a template, how far two motions are apart, frames over time."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from imgtransfer.report.pictures import CLOTH, SKIN, ShadedMesh, mesh_picture, picture_camera
from render import Camera, TemplateImager, contact_sheet
from render.pictures import heat_colours, scale_bar

_SEEN, _ELSEWHERE, _UNSEEN = (30, 120, 60), (150, 150, 150), (210, 30, 30)  # RGB of vertices
_PICTURE_SIZE = (340, 260)
_DOTS_HEIGHT = 512  # pixels, at least: below that the dots of a fine mesh run together


def template_sheet(imager: TemplateImager, *, title: str) -> np.ndarray:
    """Mask, depth and visibility of a template in each image.

    Returns:
        (H', W', 3) uint8, RGB: a column an image.
    """
    mask, depth = imager.raster.mask, imager.raster.depth
    near, far = depth[mask].min(), depth[mask].max()
    shade = 1 - 0.85 * (depth - near) / max(far - near, 1e-6)  # near is bright
    shade[~mask] = 0
    anywhere = np.asarray(imager.visible.any(axis=0))
    dots = [
        _vertex_dots(camera, imager.mesh.vertices, mask[s], imager.visible[s], anywhere)
        for s, camera in enumerate(imager.cameras)
    ]
    unseen = f"{100 * (1 - anywhere.mean()):.2f} %"
    labels = [
        "mask",
        f"depth, {near:.2f} m (bright) to {far:.2f} m",
        f"vertices: green seen here, grey in another image, red in none ({unseen})",
    ]
    views = [camera.name for camera in imager.cameras]
    scale = _dots_scale(imager.size[0])
    rows = [
        [image.repeat(scale, 0).repeat(scale, 1) for image in kind] for kind in (mask.astype(float), shade)
    ]
    return contact_sheet([*rows, dots], row_labels=labels, column_labels=views, title=title)


def difference_sheet(
    distance_mm: np.ndarray, mask: np.ndarray, views: Sequence[str], *, frames: Sequence[int], title: str
) -> np.ndarray:
    """Distances as colours, all on one scale, with its bar below.

    Args:
        distance_mm: (T, S, H, W) millimetres.
        mask: (S, H, W) bool; the rest is white.
        views: S names. frames: T numbers, for the labels.
        title: text above everything.

    Returns:
        (H', W', 3) uint8, RGB; the last colour stands for the 99th percentile and all above.
    """
    inside = distance_mm[:, mask]
    top = float(np.percentile(inside, 99)) or 1.0
    pictures = heat_colours(distance_mm / top)
    pictures[:, ~mask] = 255
    labels = [
        f"frame {frame}: mean over pixels {values.mean():.2f} mm, greatest {values.max():.2f} mm"
        for frame, values in zip(frames, inside, strict=True)
    ]
    sheet = contact_sheet(
        [[*row] for row in pictures], row_labels=labels, column_labels=list(views), title=title
    )
    return np.concatenate([sheet, scale_bar(sheet.shape[1], top, "mm")])


def frames_sheet(
    surfaces: Sequence[tuple[np.ndarray, np.ndarray]],
    names: Sequence[str],
    frames: Sequence[int],
    *,
    backend: str,
    title: str,
) -> np.ndarray:
    """Shaded meshes over time, from the front.

    Args:
        surfaces: vertices (T, N, 3) metres, canonical, and faces (F, 3) of each mesh.
        names: what each of them is; a body is drawn in the colour of skin.
        frames: T numbers, for the labels.
        backend: as for `render.rasterize`.
        title: text above everything.

    Returns:
        (H', W', 3) uint8, RGB: a column a frame.
    """
    everything = np.concatenate([vertices.reshape(-1, 3) for vertices, _ in surfaces])
    camera = picture_camera(everything, size=_PICTURE_SIZE)
    pictures = []
    for t in range(len(frames)):
        drawn = [
            ShadedMesh(vertices[t], faces, SKIN if name == "body" else CLOTH)
            for (vertices, faces), name in zip(surfaces, names, strict=True)
        ]
        pictures.append(mesh_picture(drawn, camera, backend=backend))
    return contact_sheet([pictures], column_labels=[f"frame {frame}" for frame in frames], title=title)


def _dots_scale(height: int) -> int:
    """How many times as large as the maps the template's pictures are."""
    return max(1, round(_DOTS_HEIGHT / height))


def _vertex_dots(
    camera: Camera, vertices: np.ndarray, mask: np.ndarray, here: np.ndarray, anywhere: np.ndarray
) -> np.ndarray:
    """The silhouette in light grey, with a dot for each vertex: (H', W', 3) uint8."""
    scale = _dots_scale(camera.size[0])
    grey = np.where(mask, 225, 255).astype(np.uint8)
    picture = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    picture = np.repeat(picture[..., None], 3, axis=-1)
    projected = camera.project(vertices)[:, :2] * scale
    inside = np.isfinite(projected).all(1) & (np.abs(projected) < 2 * max(picture.shape)).all(1)
    for which, colour in ((~here & anywhere, _ELSEWHERE), (here, _SEEN), (~anywhere, _UNSEEN)):
        for x, y in projected[which & inside]:
            cv2.circle(picture, (int(x), int(y)), 1, colour, -1)
    return picture
