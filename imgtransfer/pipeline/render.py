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
from render import (
    InputError,
    MapFile,
    Mesh,
    MeshSequence,
    Option,
    PositionBox,
    TemplateImager,
    write_png,
    written_maps,
)
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
    canonical = scene.canonical()
    box = _box_around(canonical["garment" if "garment" in canonical else "body"])
    shown = sorted({round(i * (scene.n_frames - 1) / (SHEET_FRAMES - 1)) for i in range(SHEET_FRAMES)})
    surfaces = []
    with written_whole_folder(target) as folder:
        for name, moved in canonical.items():
            imager = framed
            if moved.mesh is not scene.framed:
                imager = TemplateImager.build(moved.mesh, cameras=framed.cameras, backend=options.backend)
            path = folder / (f"{name}.npz" if options.file_format == "npz" else name)
            drawn, points = _write_maps(path, imager, moved, box, scene=scene, shown=shown, progress=progress)
            surfaces.append((points, moved.mesh.faces))
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
        numbers = [scene.numbers[t] for t in shown]
        picture = frames_sheet(
            surfaces, list(scene.meshes), numbers, backend=options.backend, title=scene.name
        )
        write_png(folder / "frames.png", picture)
    return distances


def _box_around(moving: MeshSequence) -> PositionBox:
    """The position box of all frames."""
    corners = [(part.min(axis=(0, 1)), part.max(axis=(0, 1))) for part in moving.parts(_BATCH)]
    return PositionBox.around(np.stack(corners))


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
    moving: MeshSequence,
    box: PositionBox,
    *,
    scene: Scene,
    shown: list[int],
    progress: Callable[[int], object] | None,
) -> tuple[MapFile, np.ndarray]:
    """Write the maps of canonical frames, some at a time; returns those of the frames `shown`, and their vertices."""
    kept: list[MapFile] = []
    kept_vertices: list[np.ndarray] = []
    first = 0
    with written_maps(path) as add:
        for vertices in moving.parts(_BATCH):
            frames = scene.frames.part(slice(first, first + len(vertices)))
            position, normal = imager.maps(torch.from_numpy(vertices), box)
            maps = MapFile.of(
                imager,
                position=position.numpy(),
                normal=normal.numpy(),
                box=box,
                rotation=frames.rotation,
                translation=frames.translation,
                fps=scene.fps,
            )
            add(maps)
            rows = [t - first for t in shown if 0 <= t - first < maps.n_frames]
            kept += [maps.part(slice(row, row + 1)) for row in rows]
            kept_vertices += [vertices[row] for row in rows]
            first += maps.n_frames
            if progress is not None:
                progress(maps.n_frames)
    together: dict[str, Any] = {
        name: np.concatenate([getattr(maps, name) for maps in kept]) for name in _SHEET_ARRAYS
    }
    return replace(kept[0], **together), np.stack(kept_vertices)


def _distances(scene: Scene, against: Scene) -> dict[str, np.ndarray]:
    """By mesh, the distance of each vertex to its place in the other scene: (T, N) float32, millimetres."""
    distances = {}
    for name, moved in scene.meshes.items():
        if name not in against.meshes:
            continue
        other = against.meshes[name]
        if moved.n_frames != other.n_frames or not _same_mesh(moved.mesh, other.mesh):
            raise InputError(
                f"{Option('against')} {against.name}: its {name} has {other.n_frames} frames of "
                f"{len(other.mesh.vertices)} vertices, or other triangles; {scene.name} has {moved.n_frames} of "
                f"{len(moved.mesh.vertices)}"
            )
        distances[name] = np.concatenate(
            [
                1000 * np.linalg.norm(one - two, axis=-1).astype(np.float32)
                for one, two in zip(moved.parts(_BATCH), other.parts(_BATCH), strict=True)
            ]
        )
    if not distances:
        raise InputError(f"{Option('against')} {against.name}: it has none of {', '.join(scene.meshes)}")
    return distances


def _same_mesh(mesh: Mesh, other: Mesh) -> bool:
    return len(mesh.vertices) == len(other.vertices) and np.array_equal(mesh.faces, other.faces)
