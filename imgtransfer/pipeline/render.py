"""Maps and sheets of a scene, written into one folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from imgtransfer.pipeline.scene import Scene
from imgtransfer.report.map_pictures import difference_sheet, frames_sheet, template_sheet
from render import InputError, MapFile, Option, PositionBox, TemplateImager, write_png, written_maps
from render.files.atomic import written_whole_folder
from render.pictures import map_sheet
from render.views import ViewsSpec

SHEET_FRAMES = 5  # rows of a sheet
_BATCH = 16  # frames that are made at a time
_SHEET_ARRAYS = ("position", "normal", "rotation", "translation")


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """How scenes are rendered.

    Args:
        size: (height, width) of the maps in pixels.
        views, layers: as for `render.frame_cameras`.
        backend: as for `render.rasterize`.
        file_format: "npz", or "exr" for folders of OpenEXR images.
    """

    size: tuple[int, int] = (256, 256)
    views: ViewsSpec = ("front", "back")
    layers: int = 1
    backend: str = "auto"
    file_format: Literal["npz", "exr"] = "npz"


def render_scene(
    scene: Scene,
    target: Path,
    options: RenderOptions,
    *,
    against: Scene | None = None,
    progress: Callable[[int], object] | None = None,
) -> dict[str, np.ndarray]:
    """Write maps and sheets of one scene; the folder appears whole or not at all.

    Args:
        scene: what to render.
        target: the folder, replaced if it exists.
        options: how.
        against: the same meshes, moved otherwise: their distance is drawn too.
        progress: called with a number of frames when they are done, for each mesh.

    Returns:
        By mesh, how far `against` is away, (T, N) float32 millimetres; empty without.

    Raises:
        InputError: what a mesh or the cameras make impossible, or `against` that has other meshes or frames.
    """
    distances = {} if against is None else _distances(scene, against)
    framed = TemplateImager.build(
        scene.framed, views=options.views, size=options.size, layers=options.layers, backend=options.backend
    )
    points = {name: scene.frames.to_canonical(moved.vertices()) for name, moved in scene.meshes.items()}
    box = PositionBox.around(points["garment" if "garment" in points else "body"])
    shown = sorted({round(i * (scene.n_frames - 1) / (SHEET_FRAMES - 1)) for i in range(SHEET_FRAMES)})
    with written_whole_folder(target) as folder:
        for name, moved in scene.meshes.items():
            imager = framed
            if moved.mesh is not scene.framed:
                imager = TemplateImager.build(moved.mesh, cameras=framed.cameras, backend=options.backend)
            path = folder / (f"{name}.npz" if options.file_format == "npz" else name)
            drawn = _write_maps(path, imager, points[name], box, scene=scene, shown=shown, progress=progress)
            sheets = _sheets(
                imager,
                drawn,
                title=f"{scene.name}: {name}",
                scene=scene,
                shown=shown,
                distance=distances.get(name),
            )
            for what, picture in sheets.items():
                write_png(folder / f"{name}_{what}.png", picture)
        surfaces = [(points[name][shown], moved.mesh.faces) for name, moved in scene.meshes.items()]
        numbers = [scene.numbers[t] for t in shown]
        picture = frames_sheet(
            surfaces, list(scene.meshes), numbers, backend=options.backend, title=scene.name
        )
        write_png(folder / "frames.png", picture)
    return distances


def _sheets(
    imager: TemplateImager,
    maps: MapFile,
    *,
    title: str,
    scene: Scene,
    shown: list[int],
    distance: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Pictures of one mesh, by the end of their file's name; `maps` are those of the frames `shown`."""
    assert maps.position is not None
    assert maps.normal is not None
    both = {"position": maps.position, "normal": maps.normal}
    numbers = [scene.numbers[t] for t in shown]
    sheets = {
        "maps": map_sheet(
            both, maps.mask, maps.views, frames=range(len(shown)), numbers=numbers, title=title
        ),
        "template": template_sheet(imager, title=f"{title} at rest"),
    }
    if distance is not None:
        images = imager.operator(torch.from_numpy(distance[shown, :, None]))[..., 0].numpy()
        sheets["difference"] = difference_sheet(
            images, maps.mask, maps.views, frames=numbers, title=f"{title}, difference"
        )
    return sheets


def _write_maps(
    path: Path,
    imager: TemplateImager,
    vertices: np.ndarray,
    box: PositionBox,
    *,
    scene: Scene,
    shown: list[int],
    progress: Callable[[int], object] | None,
) -> MapFile:
    """Write the maps of (T, N, 3) canonical vertices, some frames at a time; returns those of the frames `shown`."""
    kept: list[MapFile] = []
    with written_maps(path) as add:
        for first in range(0, len(vertices), _BATCH):
            some = slice(first, first + _BATCH)
            position, normal = imager.maps(torch.from_numpy(vertices[some]), box)
            maps = MapFile.of(
                imager,
                position=position.numpy(),
                normal=normal.numpy(),
                box=box,
                rotation=scene.frames.rotation[some],
                translation=scene.frames.translation[some],
                fps=scene.fps,
            )
            add(maps)
            kept += [
                maps.part(slice(t - first, t - first + 1)) for t in shown if 0 <= t - first < maps.n_frames
            ]
            if progress is not None:
                progress(maps.n_frames)
    together: dict[str, Any] = {
        name: np.concatenate([getattr(maps, name) for maps in kept]) for name in _SHEET_ARRAYS
    }
    return replace(kept[0], **together)


def _distances(scene: Scene, against: Scene) -> dict[str, np.ndarray]:
    """By mesh, the distance of each vertex to its place in the other scene: (T, N) float32, millimetres."""
    distances = {}
    for name, moved in scene.meshes.items():
        if name not in against.meshes:
            continue
        other = against.meshes[name]
        if moved.vertices().shape != other.vertices().shape or not np.array_equal(
            moved.mesh.faces, other.mesh.faces
        ):
            raise InputError(
                f"{Option('against')} {against.name}: its {name} has {other.n_frames} frames of "
                f"{len(other.mesh.vertices)} vertices, or other triangles; {scene.name} has {moved.n_frames} of "
                f"{len(moved.mesh.vertices)}"
            )
        distances[name] = 1000 * np.linalg.norm(moved.vertices() - other.vertices(), axis=-1).astype(
            np.float32
        )
    if not distances:
        raise InputError(f"{Option('against')} {against.name}: it has none of {', '.join(scene.meshes)}")
    return distances
