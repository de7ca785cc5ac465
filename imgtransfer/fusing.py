"""Map files and their bodies into fused vertices on disk: what stands behind `imgtransfer fuse`."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from fusion import FusionConfig
from fusion.run import fuse_maps
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import REQUIRED, Clip, load_clip, save_clip
from imgtransfer.predictions import FUSED_FILE, MESHES_FOLDER, REPORT_FILE
from render import InputError, MapFile, Mesh
from render.files import written_whole, written_whole_folder
from render.mesh import check_faces, check_finite


@dataclass(frozen=True, eq=False)
class Body:
    """A body in motion: faces (G, 3), vertices (T, B, 3) float32, metres, world; `clip` where it came from one."""

    faces: np.ndarray
    vertices: np.ndarray
    clip: Clip | None = None


@dataclass(frozen=True, eq=False)
class Fused:
    """The garment of one map file: mesh, vertices (T, N, 3) float32, metres, world; `report` for the JSON file."""

    template: Mesh
    vertices: np.ndarray
    fps: float
    body: Body | None
    report: dict[str, Any]


def load_body(path: Path) -> Body:
    """Read an npz that holds at least body_faces (G, 3) and body_vertices (T, B, 3); a clip npz will do.

    Raises:
        InputError: no such file, a damaged one, or arrays that are missing or of a wrong shape.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; an npz with body_faces and body_vertices is wanted")
    try:
        with np.load(path, allow_pickle=False) as stored:
            is_clip = set(REQUIRED) - {"garment_vertices"} <= set(stored.files)
            wanted = () if is_clip else ("body_faces", "body_vertices")
            body = {name: stored[name] for name in wanted if name in stored.files}
    except (ValueError, OSError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a readable npz of plain arrays ({error})") from error
    if is_clip:
        clip = load_clip(path)
        return Body(clip.body_faces, clip.body_vertices, clip)
    missing = [name for name in ("body_faces", "body_vertices") if name not in body]
    if missing:
        raise InputError(f"{path}: lacks {' and '.join(missing)}; the body needs both")
    faces, vertices = body["body_faces"], body["body_vertices"]
    if vertices.ndim != 3 or vertices.shape[2] != 3:
        raise InputError(
            f"{path}: body_vertices must have shape (frames, vertices, 3), found {vertices.shape}"
        )
    check_faces(faces, vertices.shape[1], f"{path}: body_faces")
    check_finite(vertices, f"{path}: body_vertices")
    return Body(faces, vertices)


def fused(
    maps: MapFile,
    body: Body | None = None,
    *,
    template: Mesh | None = None,
    config: FusionConfig,
    positions_only: bool = False,
    device: str = "cpu",
    progress: Callable[[int], object] | None = None,
) -> Fused:
    """Fuse a map file, outside the body if there is one, and put the canonical frames back.

    Raises:
        InputError: a body of another number of frames, or what `fuse_maps` refuses.
    """
    frames = RootFrames(maps.rotation, maps.translation)
    if body is not None and len(body.vertices) != len(maps.rotation):
        raise InputError(
            f"body_vertices must have {len(maps.rotation)} frames, as the maps have {len(maps.rotation)}; "
            f"found {len(body.vertices)}"
        )
    template = template or maps.template
    result = fuse_maps(
        maps,
        template=template,
        body_vertices=frames.to_canonical(body.vertices) if body else None,
        body_faces=body.faces if body else None,
        positions_only=positions_only,
        config=config,
        device=device,
        progress=progress,
    )
    report = result.report | {"positions_only": positions_only, "config": config.model_dump()}
    return Fused(template, frames.to_world(result.vertices), maps.fps, body, report)


def save_fused(folder: Path, result: Fused, *, meshes: str | None = None) -> None:
    """Write the report, the meshes if asked for ("obj", "ply"), and last fused.npz; each whole or not at all.

    fused.npz is the body's clip with the fused garment, and says how it was fused (`fused_as`). Without a clip it holds
    the garment's arrays, and those of the body if there is one.
    """
    with written_whole(folder / REPORT_FILE) as temporary:
        temporary.write_text(json.dumps(result.report, indent=2) + "\n")
    if meshes:
        save_meshes(folder, result.vertices, result.template.faces, meshes)
    template = np.asarray(result.template.vertices, np.float32)
    faces, vertices, body = result.template.faces, result.vertices, result.body
    if body is not None and body.clip is not None:
        made = settings(result.report["config"], result.report["positions_only"])
        clip = replace(
            body.clip,
            template_vertices=template,
            garment_faces=faces,
            garment_vertices=vertices,
            info=body.clip.info | {"fusion": made},
        )
        save_clip(folder / FUSED_FILE, clip)
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


def save_meshes(folder: Path, vertices: np.ndarray, faces: np.ndarray, kind: str) -> None:
    """Write one mesh file a frame of vertices (T, N, 3) to the folder of meshes, which is replaced as a whole."""
    with written_whole_folder(folder / MESHES_FOLDER) as temporary:
        for number, frame in enumerate(vertices):
            mesh = trimesh.Trimesh(frame, faces, process=False)
            mesh.export(temporary / f"frame_{number:04d}.{kind}")


def settings(config: dict[str, Any], positions_only: bool) -> str:
    """One line for what decides the result of a fusion besides the maps; `config` is a dumped `FusionConfig`."""
    return json.dumps(config | {"positions_only": positions_only}, sort_keys=True)


def fused_as(path: Path) -> str | None:
    """The settings that a fused.npz was made with; None where it is missing, damaged or does not say."""
    try:
        return load_clip(path).info.get("fusion")
    except InputError:
        return None
