"""`imgtransfer fuse`: maps to meshes, also maps that another model made."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    import numpy as np

    from render import MapFile

WRITTEN = ("fused.npz", "report.json", "meshes")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "fuse",
        help="recover meshes from position and normal maps",
        description="Reads a map file (as `imgtransfer render` and `predict` write it), recovers the "
        "garment's vertices and writes them in world coordinates to OUT/fused.npz, with OUT/report.json.",
    )
    parser.add_argument("--maps", required=True, type=Path, help="map file, npz")
    parser.add_argument("--template", type=Path, help="mesh in place of the map file's template")
    parser.add_argument(
        "--body",
        type=Path,
        help="npz with body_faces and body_vertices (frames, vertices, 3) in world coordinates, metres; "
        "a clip npz will do. The garment is then kept out of the body",
    )
    parser.add_argument("--config", type=Path, help="YAML with the fusion's hyper-parameters that differ")
    parser.add_argument("--positions-only", action="store_true", help="leave the normal maps out")
    parser.add_argument("--meshes", choices=("obj", "ply"), help="also write one mesh file a frame")
    parser.add_argument(
        "--device", default="cpu", help="torch device that computes: cpu or cuda; default cpu"
    )
    parser.add_argument("--out", required=True, type=Path, help="folder for the results")
    return parser


def run(args: argparse.Namespace) -> None:
    """Fuse one map file; the folder appears whole or not at all."""
    from tqdm import tqdm  # noqa: PLC0415

    from fusion.config import FusionConfig, load_config  # noqa: PLC0415
    from fusion.run import fuse_maps  # noqa: PLC0415
    from imgtransfer.data.canonical import RootFrames  # noqa: PLC0415
    from render import load_maps, load_mesh  # noqa: PLC0415

    _check_out(args.out)
    _check_device(args.device)
    config = load_config(args.config) if args.config else FusionConfig()
    maps = load_maps(args.maps)
    template = load_mesh(args.template) if args.template else maps.template
    frames = RootFrames(maps.rotation, maps.translation)
    body = load_body(args.body, len(maps.rotation)) if args.body else {}
    with tqdm(total=len(maps.rotation), desc="fuse", unit="frame") as bar:
        result = fuse_maps(
            maps,
            template=template,
            body_vertices=frames.to_canonical(body["body_vertices"]) if body else None,
            body_faces=body["body_faces"] if body else None,
            positions_only=args.positions_only,
            config=config,
            device=args.device,
            progress=bar.update,
        )
    maps = replace(maps, template_vertices=template.vertices, template_faces=template.faces)
    report = result.report | {"maps": args.maps.name, "config": config.model_dump()}
    _write(args, maps, frames.to_world(result.vertices), body, report)
    print(f"{args.out}  {report['frames']} frames, {report['seconds']:.1f} s")


def load_body(path: Path, n_frames: int) -> dict[str, np.ndarray]:
    """All arrays of an npz that holds at least body_faces (G, 3) and body_vertices (n_frames, B, 3).

    Raises:
        InputError: no such file, a damaged one, or arrays that are missing or of a wrong shape.
    """
    import zipfile  # noqa: PLC0415

    import numpy as np  # noqa: PLC0415

    from render.mesh import check_faces, check_finite  # noqa: PLC0415

    if not path.is_file():
        raise InputError(f"{path}: no such file; --body wants an npz with body_faces and body_vertices")
    try:
        with np.load(path, allow_pickle=False) as stored:
            body = {name: stored[name] for name in stored.files}
    except (ValueError, OSError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a readable npz of plain arrays ({error})") from error
    missing = [name for name in ("body_faces", "body_vertices") if name not in body]
    if missing:
        raise InputError(f"{path}: lacks {' and '.join(missing)}; --body wants both")
    vertices = body["body_vertices"]
    if vertices.ndim != 3 or vertices.shape[2] != 3 or len(vertices) != n_frames:
        raise InputError(
            f"{path}: body_vertices must have shape ({n_frames}, vertices, 3), as the maps have {n_frames} "
            f"frames; found {vertices.shape}"
        )
    check_faces(body["body_faces"], vertices.shape[1], f"{path}: body_faces")
    check_finite(vertices, f"{path}: body_vertices")
    return body


def _check_out(out: Path) -> None:
    """Refuse to replace a folder that holds anything but an earlier result."""
    if out.exists() and (not out.is_dir() or any(entry.name not in WRITTEN for entry in out.iterdir())):
        raise InputError(f"--out {out}: holds other files, which would be lost; name a new folder")


def _check_device(device: str) -> None:
    import torch  # noqa: PLC0415

    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {device}: not usable here ({reason}); use cpu") from error


def _write(
    args: argparse.Namespace,
    maps: MapFile,
    vertices: np.ndarray,
    body: dict[str, np.ndarray],
    report: dict[str, Any],
) -> None:
    """Write fused.npz, report.json and, if asked for, the meshes; `vertices` (T, N, 3) are in the world."""
    import json  # noqa: PLC0415

    import trimesh  # noqa: PLC0415

    from render.files import written_whole_folder  # noqa: PLC0415

    with written_whole_folder(args.out) as folder:
        _save_vertices(folder / "fused.npz", args.body, maps, vertices, body)
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n")
        if args.meshes:
            (folder / "meshes").mkdir()
            for number, frame in enumerate(vertices):
                mesh = trimesh.Trimesh(frame, maps.template_faces, process=False)
                mesh.export(folder / "meshes" / f"frame_{number:04d}.{args.meshes}")


def _save_vertices(
    path: Path, body_path: Path | None, maps: MapFile, vertices: np.ndarray, body: dict[str, np.ndarray]
) -> None:
    """A clip npz with the fused garment if --body is a clip, else the arrays of the garment and the body."""
    import numpy as np  # noqa: PLC0415

    from imgtransfer.data.clip import REQUIRED, load_clip, save_clip  # noqa: PLC0415

    template, faces = np.asarray(maps.template_vertices, np.float32), maps.template_faces
    if body_path is not None and set(REQUIRED) - {"garment_vertices"} <= set(body):
        clip = load_clip(body_path)
        fused = replace(clip, template_vertices=template, garment_faces=faces, garment_vertices=vertices)
        save_clip(path, fused)
        return
    arrays: dict[str, Any] = {name: body[name] for name in ("body_faces", "body_vertices") if name in body}
    arrays |= {"template_vertices": template, "garment_faces": faces, "garment_vertices": vertices}
    np.savez_compressed(path, fps=np.float64(maps.fps), **arrays)
