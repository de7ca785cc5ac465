"""Map files and what belongs to them into fused vertices on disk: what stands behind `imgtransfer fuse`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion import FusionConfig
from fusion.run import fuse_maps
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import load_clip, save_clip
from imgtransfer.data.mesh_output import MeshKind, save_mesh_frames
from imgtransfer.moving import Moving, Pins
from imgtransfer.predictions import FUSED_FILE, HISTORY_FILE, MESHES_FOLDER, REPORT_FILE
from render import InputError, MapFile, Mesh, write_png
from render.files import written_whole
from render.mesh import check_finite


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """What a map file may be fused with, in world coordinates, metres.

    Args:
        template: in place of the map file's.
        initial: garment to start from in place of the position maps; T frames.
        body: what the garment must stay outside of; T frames.
        under: another garment, worn beneath; T frames.
        pins: vertices that stay in place.
    """

    template: Mesh | None = None
    initial: Moving | None = None
    body: Moving | None = None
    under: Moving | None = None
    pins: Pins | None = None


@dataclass(frozen=True, kw_only=True)
class Ways:
    """How to fuse: the choices that, with the maps, decide the result. Arguments as for `fusion.run.fuse_maps`."""

    config: FusionConfig
    positions_only: bool = False
    erode: int = 0

    def as_text(self) -> str:
        """One line, for results to say what they were made with."""
        choices = {"positions_only": self.positions_only, "erode": self.erode}
        return json.dumps(self.config.model_dump() | choices, sort_keys=True)


@dataclass(frozen=True, eq=False)
class Fused:
    """The garment of one map file: mesh at rest, vertices (T, N, 3) float32, metres, world; `report` for the JSON."""

    template: Mesh
    vertices: np.ndarray
    fps: float
    body: Moving | None
    ways: Ways
    report: dict[str, Any]


def fused(
    maps: MapFile,
    given: Given,
    ways: Ways,
    *,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> Fused:
    """Fuse a map file in its canonical frames, and put these back.

    Raises:
        InputError: something given has another number of frames, or what `fuse_maps` refuses.
    """
    frames, n_frames = RootFrames(maps.rotation, maps.translation), len(maps.rotation)
    canonical: dict[str, Any] = {}
    for name in ("body", "under", "initial"):
        moving = getattr(given, name)
        if moving is None:
            continue
        if len(moving.vertices) != n_frames:
            raise InputError(
                f"--{name}: {n_frames} frames are wanted, as the maps have {n_frames}; found {len(moving.vertices)}"
            )
        check_finite(moving.vertices, f"--{name}")
        vertices = frames.to_canonical(moving.vertices)
        if name == "initial":
            canonical["initial"] = vertices
        else:
            canonical |= {f"{name}_vertices": vertices, f"{name}_faces": moving.faces}
    if given.pins is not None:
        given.pins.check(len(maps.template_vertices))
        positions = given.pins.over(n_frames)
        canonical["pinned"] = given.pins.indices
        canonical["pinned_positions"] = None if positions is None else frames.to_canonical(positions)
    result = fuse_maps(
        maps,
        template=given.template,
        positions_only=ways.positions_only,
        erode=ways.erode,
        **canonical,
        config=ways.config,
        device=device,
        history=history,
        progress=progress,
    )
    made = {"positions_only": ways.positions_only, "erode": ways.erode, "config": ways.config.model_dump()}
    vertices = frames.to_world(result.vertices)
    template = given.template or _with_look(maps.template, given.body)
    if maps.rest_vertices is not None:
        template = replace(template, vertices=maps.rest_vertices)
    return Fused(template, vertices, maps.fps, given.body, ways, result.report | made)


def _with_look(template: Mesh, body: Moving | None) -> Mesh:
    """The template with the texture coordinates and numbering of the body's clip, if that is of the same garment."""
    clip = body.clip if body is not None else None
    if clip is None or not np.array_equal(clip.garment_faces, template.faces):
        return template
    return replace(template, surface=clip.surface)


def save_fused(folder: Path, result: Fused, *, meshes: MeshKind | None = None) -> None:
    """Write the report, its picture if it has a history, the meshes if asked for, and last fused.npz.

    Each appears whole or not at all. fused.npz is the body's clip with the fused garment, and says how it was fused
    (`fused_as`). Without a clip it holds the garment's arrays, and those of the body if there is one.
    """
    if "history" in result.report:
        from imgtransfer.report.fusion_history import history_picture  # noqa: PLC0415

        write_png(folder / HISTORY_FILE, history_picture(result.report["history"], result.ways.config))
    else:
        (folder / HISTORY_FILE).unlink(missing_ok=True)
    with written_whole(folder / REPORT_FILE) as temporary:
        temporary.write_text(json.dumps(result.report, indent=2) + "\n")
    if meshes:
        save_mesh_frames(folder / MESHES_FOLDER, result.vertices, result.template, meshes)
    template = np.asarray(result.template.vertices, np.float32)
    faces, vertices, body = result.template.faces, result.vertices, result.body
    if body is not None and body.clip is not None:
        clip = replace(
            body.clip,
            template_vertices=template,
            garment_faces=faces,
            garment_vertices=vertices,
            original_faces=None,  # these and the next are those of the clip's own garment, which may be another one
            original_vertices=None,
            uvs=None,
            uv_faces=None,
            face_materials=None,
            info=body.clip.info | {"fusion": result.ways.as_text()},
        )
        save_clip(folder / FUSED_FILE, clip.with_surface(result.template.surface))
        return
    arrays: dict[str, Any] = {
        "template_vertices": template,
        "garment_faces": faces,
        "garment_vertices": vertices,
    }
    if body is not None:
        arrays |= {"body_faces": body.faces, "body_vertices": body.vertices}
    with written_whole(folder / FUSED_FILE) as temporary:
        np.savez_compressed(temporary, fps=np.float64(result.fps), **arrays)


def fused_as(path: Path) -> str | None:
    """`Ways.as_text` of what a fused.npz was made with; None where it is missing, damaged or does not say."""
    try:
        return load_clip(path).info.get("fusion")
    except InputError:
        return None
