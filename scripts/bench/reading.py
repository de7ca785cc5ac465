#!/usr/bin/env python
"""Reading meshes and meshes in motion, beside the other readers of the same files.

files: a folded sheet of a million vertices and two million triangles, with a texture coordinate a vertex.
The others: a sheet of 12,000 vertices in 2,000 frames; of OBJ, PLY and GLB a file a frame, of which 20 are different.
Readers of these are timed with 40 frames, meshio with 4. Memory is of a process that reads 200 frames and then 2,000.

  obj_s, ply_s, glb_s          seconds of load_mesh
  *_trimesh_s, *_meshio_s      of others, vertices in the file's order where they can; meshio needs minutes for OBJ
  frames_per_s                 of ours; trimesh_, meshio_ and plain_: of the others. Plain is NumPy for PC2, and
                               alembic3d and usd-core for their formats, without any check
  ratio_*ours_to_NAME          how many times as long ours takes; the largest is to the fastest reader
  ratio_*ours_to_fastest       that one
  start_ms                     until ours has the first frame, where a process of its own reads
  short_mb, long_mb            most resident memory after the short sequence and after the long one
  ratio_long_to_short_mb       1 where frames are let go
  long_frames_per_s            of ours, over the whole long one
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

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

ROOT = Path(__file__).resolve().parents[2]
PART = 32  # frames in memory at a time
DIFFERENT = 20  # files behind all frames
_PC2_HEAD = 32  # bytes
_CHILD = """
import json, resource, sys, time
from pathlib import Path
from render.files.mesh_files import load_mesh
from render.files.sequence import open_sequence

def peak_mb():
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    kilobytes = [int(line.split()[1]) for line in lines if line.startswith("VmHWM")]
    in_kilobytes = 1e6 if sys.platform == "darwin" else 1e3
    own, others = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return (kilobytes[0] / 1e3 if kilobytes else own / in_kilobytes) + others / in_kilobytes

told = []
for path in sys.argv[2:]:
    started = time.perf_counter()
    frames = sum(len(part) for part in open_sequence(Path(path), load_mesh(sys.argv[1])).parts(32))
    told.append([frames / (time.perf_counter() - started), peak_mb()])
print(json.dumps(told))
"""

Frames = Callable[[int], object]  # reads as many frames


@dataclass(frozen=True, eq=False)
class _Motion:
    """A mesh, its different frames (D, N, 3), how many files are timed, and the lengths that memory is measured at."""

    mesh: Mesh
    frames: np.ndarray
    timed: int
    lengths: tuple[int, int]


def measure(quick: bool) -> Results:
    """All numbers, one section for large files and one for each kind of sequence."""
    mesh = _sheet(12 if quick else 110)
    frames = mesh.vertices + np.linspace(0, 1, DIFFERENT)[:, None, None]
    moving = _Motion(mesh, frames, *((10, (20, 40)) if quick else (40, (200, 2000))))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results = {"files": _large(folder, 30 if quick else 1000)}
        results |= {kind: _files_in_motion(folder / kind, kind, moving) for kind in ("obj", "ply", "glb")}
        template = next((folder / "obj/frames").glob("*.obj"))
        results["pc2"] = _point_cache(folder, template, moving)
        if all(find_spec(library) for library in ("alembic3d", "pxr", "pytest")):
            results |= _scenes(folder, template, moving)
        return results


def _large(folder: Path, side: int) -> dict[str, float]:
    mesh = _sheet(side)
    found: dict[str, float] = {"vertices": len(mesh.vertices)}
    for kind, readers in {
        "obj": {"trimesh": _trimesh},
        "ply": {"trimesh": _trimesh, "meshio": meshio.read},
        "glb": {"trimesh": _trimesh},
    }.items():
        _write(folder / f"large_{kind}", kind, mesh, mesh.vertices[None])
        (file,) = (folder / f"large_{kind}").glob(f"*.{kind}")
        alternatives = {name: partial(read, file) for name, read in {"ours": load_mesh, **readers}.items()}
        times = interleaved(alternatives, rounds=1 if kind == "obj" else 3)  # text takes half a minute
        found[f"{kind}_s"] = times.s("ours")
        found |= {f"{kind}_{name}_s": times.s(name) for name in readers}
        ratios = {name: times.ratio("ours", name) for name in readers}
        found |= {f"ratio_{kind}_ours_to_{name}": ratio for name, ratio in ratios.items()}
        found[f"ratio_{kind}_ours_to_fastest"] = max(ratios.values())
    return found


def _files_in_motion(folder: Path, kind: str, moving: _Motion) -> dict[str, float]:
    """Frames of one file each."""
    _write(folder / "frames", kind, moving.mesh, moving.frames)
    real = sorted((folder / "frames").glob(f"*.{kind}"))
    timed, short, long = (
        _linked(folder / str(count), real, count) for count in (moving.timed, *moving.lengths)
    )
    files = sorted(timed.iterdir())

    def other(read: Callable[[Path], object]) -> Frames:
        return lambda count: [read(file) for file in files[:count]]

    others = {"trimesh": (other(_trimesh), moving.timed)}
    if kind != "glb":  # which it does not know
        others["meshio"] = (other(meshio.read), moving.timed // 10)
    return _speeds(partial(_read, timed), others, moving.timed) | _memory(real[0], short, long)


def _point_cache(folder: Path, template: Path, moving: _Motion) -> dict[str, float]:
    n_values = moving.frames[0].size
    for count in moving.lengths:
        with (folder / f"{count}.pc2").open("wb") as file:
            file.write(b"POINTCACHE2\0" + struct.pack("<iiffi", 1, n_values // 3, 0, 1, count))
            for frame in range(count):
                file.write(moving.frames[frame % DIFFERENT].astype("<f4").tobytes())
    short, long = (folder / f"{count}.pc2" for count in moving.lengths)

    def plain(count: int) -> None:
        for first in range(0, count, PART):
            part = min(PART, count - first)
            np.fromfile(long, "<f4", part * n_values, offset=_PC2_HEAD + 4 * first * n_values)

    count = moving.lengths[1]
    found = _speeds(lambda: _read(long, moving.mesh), {"plain": (plain, count)}, count)
    return found | _memory(template, short, long)


def _scenes(folder: Path, template: Path, moving: _Motion) -> dict[str, dict[str, float]]:
    from tests.helpers.scenes import Written, write_abc, write_usd  # noqa: PLC0415  (needs both libraries)

    results = {}
    faces = moving.mesh.faces
    for kind, plain in (("abc", _plain_alembic), ("usdc", _plain_usd)):
        for count in moving.lengths:
            frames = moving.frames[np.arange(count) % DIFFERENT].astype(np.float32)
            cloth = Written(frames, np.arange(count) / 24, [3] * len(faces), faces.ravel().tolist())
            (write_abc if kind == "abc" else write_usd)(folder / f"{count}.{kind}", {"/cloth": cloth})
        short, long = (folder / f"{count}.{kind}" for count in moving.lengths)
        count = moving.lengths[1]
        found = _speeds(partial(_read, long), {"plain": (partial(plain, long), count)}, count)
        found["start_ms"] = interleaved({"ours": partial(_first, short)}, rounds=3).ms("ours")
        results[kind] = found | _memory(template, short, long)
    return results


def _plain_alembic(path: Path, count: int) -> None:
    from alembic3d import Abc, AbcGeom  # noqa: PLC0415  (an extra)

    archive = Abc.IArchive(str(path))
    node = archive.getTop().getChild(0)
    positions = AbcGeom.IPolyMesh(node, Abc.WrapExistingFlag.kWrapExisting).getSchema().getPositionsProperty()
    for frame in range(count):
        np.array(positions.getValue(Abc.ISampleSelector(frame / 24)), np.float32)


def _plain_usd(path: Path, count: int) -> None:
    from pxr import Usd, UsdGeom  # noqa: PLC0415  (an extra)

    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/cloth")).GetPointsAttr()
    for frame in range(count):
        np.array(points.Get(frame))


def _speeds(
    ours: Callable[[], object], others: dict[str, tuple[Frames, int]], timed: int
) -> dict[str, float]:
    """Frames a second and ratios; other readers with the number of frames that each shall read."""
    alternatives = {name: partial(read, count) for name, (read, count) in others.items()}
    times = interleaved({"ours": ours, **alternatives}, rounds=1)
    frames = {"ours": timed} | {name: count for name, (_, count) in others.items()}
    ratios = {name: times.ratio("ours", name) * frames[name] / timed for name in others}
    return (
        {"frames_per_s": timed / times.s("ours")}
        | {f"{name}_frames_per_s": frames[name] / times.s(name) for name in others}
        | {f"ratio_ours_to_{name}": ratio for name, ratio in ratios.items()}
        | {"ratio_ours_to_fastest": max(ratios.values())}
    )


def _memory(template: Path, short_sequence: Path, long_sequence: Path) -> dict[str, float]:
    """Peaks of a process that reads the short sequence, and then the long one."""
    words = [sys.executable, "-c", _CHILD, *map(str, (template, short_sequence, long_sequence))]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    (_, short), (speed, long) = json.loads(done.stdout)
    return {
        "short_mb": short,
        "long_mb": long,
        "ratio_long_to_short_mb": long / short,
        "long_frames_per_s": speed,
    }


def _read(source: Path, mesh: Mesh | None = None) -> None:
    for _ in open_sequence(source, mesh).parts(PART):
        pass


def _first(source: Path) -> None:
    next(open_sequence(source).parts(1))


def _write(folder: Path, kind: str, mesh: Mesh, frames: np.ndarray) -> None:
    if kind != "glb":
        save_mesh_frames(folder, frames, mesh, kind)  # type: ignore[arg-type]
        return
    folder.mkdir(parents=True)
    visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2])
    for number, vertices in enumerate(frames):
        written: Any = trimesh.Trimesh(vertices, mesh.faces, process=False, visual=visual)
        written.export(folder / f"frame_{number:04}.glb")


def _linked(folder: Path, real: Sequence[Path], count: int) -> Path:
    """A folder with so many frames, which are the real ones in turn."""
    folder.mkdir()
    for number in range(count):
        file = real[number % len(real)]
        (folder / f"f_{number:05}{file.suffix}").hardlink_to(file)
    return folder


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
