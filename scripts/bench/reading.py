#!/usr/bin/env python
"""Reading meshes: this project's readers beside trimesh's and meshio's, and a moving mesh of one file a frame.

A folded sheet of a million vertices and two million triangles with a texture coordinate a vertex.
Sequences are 100 OBJ frames of 12,000 vertices, read as `import meshes` reads them: the first frame whole, of the
others the vertices, as long as all else is the same.

  obj_s, ply_s, glb_s              seconds of load_mesh
  *_trimesh_s, *_meshio_s          of the other readers of the same file, vertices in the file's order where they can
  ratio_*_ours_to_fastest          how many times as long ours takes as the fastest other one
  sequence_frames_per_s            of OBJ frames
  sequence_trimesh_frames_per_s    reading every frame with trimesh
  ratio_sequence_ours_to_trimesh   how many times as long ours takes
  sequence_mb                      most memory while frames are read 32 at a time
  ratio_sequence_mb_all_to_half    the same over that of half as many frames: 1, as frames are let go
"""

from __future__ import annotations

import sys
import tempfile
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import meshio
import numpy as np
import trimesh

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.data.mesh_output import save_mesh_frames
from render import Mesh, load_mesh
from render.files.sequence import open_sequence
from render.mesh.surface import Surface
from scripts.bench.measuring import Results, command, interleaved

PART = 32  # frames in memory at a time


def measure(quick: bool) -> Results:
    """All numbers, one section for large files and one for sequences."""
    with tempfile.TemporaryDirectory() as folder:
        side, frames, rounds = (30, 80, 1) if quick else (1000, 100, 1)  # meshio takes a minute a call
        files = _large(Path(folder), side, rounds)
        return {"files": files, "sequence": _sequence(Path(folder), 12 if quick else 110, frames, rounds)}


def _large(folder: Path, side: int, rounds: int) -> dict[str, float]:
    mesh = _sheet(side)
    for kind in ("obj", "ply"):
        save_mesh_frames(folder / kind, mesh.vertices[None], mesh, kind)  # type: ignore[arg-type]
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(folder / "frame.glb")
    found: dict[str, float] = {"vertices": len(mesh.vertices)}
    others: dict[str, dict[str, Callable[[Path], object]]] = {
        "obj": {"trimesh": _trimesh, "meshio": meshio.read},
        "ply": {"trimesh": _trimesh, "meshio": meshio.read},
        "glb": {"trimesh": _trimesh},
    }
    for kind, readers in others.items():
        file = folder / ("frame.glb" if kind == "glb" else f"{kind}/frame_0000.{kind}")
        times = interleaved(
            {name: partial(read, file) for name, read in {"ours": load_mesh, **readers}.items()},
            rounds=rounds,
        )
        found[f"{kind}_s"] = times.s("ours")
        found |= {f"{kind}_{name}_s": times.s(name) for name in readers}
        found[f"ratio_{kind}_ours_to_fastest"] = max(times.ratio("ours", name) for name in readers)
    return found


def _sequence(folder: Path, side: int, frames: int, rounds: int) -> dict[str, float]:
    mesh = _sheet(side)
    moved = mesh.vertices + np.linspace(0, 1, frames)[:, None, None]
    save_mesh_frames(folder / "all", moved, mesh, "obj")
    save_mesh_frames(folder / "half", moved[: frames // 2], mesh, "obj")
    files = sorted((folder / "all").glob("*.obj"))
    times = interleaved(
        {
            "ours": lambda: _read_all(folder / "all"),
            "trimesh": lambda: [_trimesh(file) for file in files],
        },
        rounds=rounds,
    )
    most, most_of_half = _most_bytes(folder / "all"), _most_bytes(folder / "half")
    return {
        "sequence_vertices": len(mesh.vertices),
        "sequence_frames_per_s": frames / times.s("ours"),
        "sequence_trimesh_frames_per_s": frames / times.s("trimesh"),
        "ratio_sequence_ours_to_trimesh": times.ratio("ours", "trimesh"),
        "sequence_mb": most / 1e6,
        "ratio_sequence_mb_all_to_half": most / most_of_half,
    }


def _read_all(folder: Path) -> None:
    for _ in open_sequence(folder).parts(PART):
        pass


def _most_bytes(folder: Path) -> int:
    tracemalloc.start()
    try:
        _read_all(folder)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _trimesh(path: Path) -> object:
    return trimesh.load(path, process=False, maintain_order=True)


def _sheet(side: int) -> Mesh:
    """A folded square sheet of side * side vertices, with texture coordinates."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    vertices = np.stack([x, y, 0.05 * np.sin(40 * x + 9 * y)], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(side - 1), np.arange(side - 1), indexing="ij")
    a = (row * side + column).reshape(-1)
    faces = np.concatenate(
        [np.stack([a, a + 1, a + side + 1], -1), np.stack([a, a + side + 1, a + side], -1)]
    )
    uvs = vertices[:, :2].astype(np.float32)
    return Mesh(vertices, faces, surface=Surface(faces, np.arange(side * side), uvs=uvs, uv_faces=faces))


if __name__ == "__main__":
    command(__doc__, measure)
