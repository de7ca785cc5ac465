"""Cameras framed on a garment template, and the elevations of those that are left to choose."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from render.cameras import Camera, check_size, perspective
from render.errors import InputError
from render.limits import MAX_LAYERS
from render.mesh.mesh import Mesh
from render.raster.visibility import visible_vertices
from render.views import View, ViewsSpec, parse_views

_HEIGHTS = (0, -10, 10, -20, 20, -30, 30, -40, 40)  # degrees, what ties prefer first
# What a tilt must show more, as a fraction of the vertices per degree: 10 degrees for 0.03 %. Level views keep what
# lies behind one another apart at hems and shoulders, and are what people expect to see.
_PRICE = 3e-5


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
        margin: fraction of the image's height and width that stays free at each border.
        layers: how many surfaces deep each view is imaged.

    Returns:
        For each view in the order given one camera a layer, named "front", "front/1", "front/2" and so on.

    Raises:
        InputError: unknown or repeated views, none at all, or layers, a size, field of
            view or margin that make no image.
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


def choose_elevations(
    template: Mesh, views: Sequence[View], frame: Callable[[View], Camera]
) -> tuple[View, ...]:
    """Give every view without an elevation the one from which all views together see most of the vertices.

    One view after the other is raised or lowered in steps of 10 degrees up to 40 while the others stay, until
    nothing is gained. Level four-side views of the public T-shirt miss the tops of its shoulders, those of the
    dress the inside of a fold.

    Args:
        template: what is looked at.
        views: those that have an elevation keep it.
        frame: makes the camera of a view that has an elevation.

    Returns:
        The views in the same order, each with its elevation.
    """
    free = [place for place, view in enumerate(views) if view.elevation is None]
    chosen = [replace(view, elevation=view.elevation or 0.0) for view in views]
    known: dict[View, np.ndarray] = {}

    def seen(view: View) -> np.ndarray:
        if view not in known:
            known[view] = visible_vertices(template, frame(view))
        return known[view]

    while free:
        before = tuple(chosen)
        for place in free:
            others = [seen(view) for other, view in enumerate(chosen) if other != place]
            unseen = ~np.any(others, axis=0) if others else np.ones(len(template.vertices), bool)
            candidates = [replace(chosen[place], elevation=float(height)) for height in _HEIGHTS]
            worth = [(seen(view) & unseen).mean() - _PRICE * abs(view.elevation or 0) for view in candidates]
            chosen[place] = candidates[int(np.argmax(worth))]
        if tuple(chosen) == before:
            break
    return tuple(chosen)
