"""A process of its own that reads a scene file, so that only it ends where a format's library fails on a damaged file.

alembic3d ends its process on some damaged files, and usd-core writes to stderr. `python -m render.files.scenes.process
FILE [OBJECT [FRAME ...]]` answers on stdout: a line of JSON, the arrays that it names, and then frame after frame (all,
or those of the numbers given), as fast as the caller takes them.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from render.errors import InputError, said_by
from render.files.scenes.objects import SceneFile, SceneMesh, matching
from render.files.scenes.times import FrameTimes, frame_times
from render.memory import available_bytes

FRAME, FAULT = b"+", b"-"  # what begins a frame, and the line of JSON in place of one
_ROOM = 8 * 2**30  # bytes of addresses that libraries and threads reserve, and never use


def main(path: Path, wanted: str | None, numbers: Sequence[int] = ()) -> None:
    """Answer with the one mesh that is wanted; with the names of all where that is not one."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries may print
    _limit()
    try:
        for content in answer(path, wanted, numbers):
            out.write(content)
        out.flush()
    except BrokenPipeError:  # the caller has what it wanted
        pass
    os._exit(0)  # the libraries' own ends take time, and may fail on damaged files


def answer(path: Path, wanted: str | None, numbers: Sequence[int] = ()) -> Iterator[bytes]:
    """What is written for a file, in pieces; faults become the last piece. All frames, unless `numbers` are given."""
    started = False
    try:
        scene = _open(path)
        names = scene.names(hidden=False)
        chosen = names if wanted is None else matching(names, wanted)
        if wanted is not None and not chosen:
            chosen = matching(scene.names(hidden=True), wanted)
        if len(chosen) != 1:
            yield _line({"names": names or scene.names(hidden=True), "chosen": chosen, "seen": bool(names)})
            return
        mesh = scene.mesh(chosen[0])
        frames = frame_times(mesh.times, mesh.rate, mesh.polygons.source)
        arrays = _arrays(mesh, mesh.points(frames.seconds[0], 0))
        header = _header(mesh, frames) | {
            name: [array.dtype.str, array.shape] for name, array in arrays.items()
        }
        yield _line(header)
        for array in arrays.values():
            yield array.tobytes()
        started = True
        for number in numbers or range(len(frames.seconds)):
            vertices = mesh.points(float(frames.seconds[number]), number).astype("<f4")
            yield FRAME + vertices.tobytes()
    except InputError as error:
        yield (FAULT if started else b"") + _line({"error": str(error)})
    except Exception as error:  # the libraries raise whatever they meet
        said = f"{path}: cannot be read, is it damaged? ({said_by(error)})"
        yield (FAULT if started else b"") + _line({"error": said})


def _open(path: Path) -> SceneFile:
    if path.suffix.lower() == ".abc":
        from render.files.scenes.alembic import AlembicScene  # noqa: PLC0415  (an extra)

        return AlembicScene(path)
    from render.files.scenes.usd import UsdScene  # noqa: PLC0415  (an extra)

    return UsdScene(path)


def _header(mesh: SceneMesh, frames: FrameTimes) -> dict[str, Any]:
    return {
        "path": mesh.path,
        "frames": len(frames.seconds),
        "fps": frames.fps,
        "start": float(frames.seconds[0]),
        "note": frames.note,
        "materials": mesh.look.materials,
        "up": mesh.up,
        "metres": mesh.metres,
    }


def _arrays(mesh: SceneMesh, first: np.ndarray) -> dict[str, np.ndarray]:
    """What `render.files.scenes.reader` makes a mesh of; without texture or materials, their arrays are empty."""
    corners, polygon = mesh.polygons.triangles(backwards=mesh.backwards)
    look = mesh.look
    none = np.zeros((0, 3), np.int64)
    return {
        "vertices": first.astype("<f8"),
        "faces": mesh.polygons.vertices[corners].astype("<i8"),
        "uvs": np.zeros((0, 2), "<f4") if look.uvs is None else look.uvs.astype("<f4"),
        "uv_faces": none if look.uv_corners is None else look.uv_corners[corners].astype("<i8"),
        "face_materials": none
        if look.polygon_materials is None
        else look.polygon_materials[polygon].astype("<i8"),
    }


def _line(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer).encode() + b"\n"


def _limit() -> None:
    """No more memory than is free, whatever a damaged file counts, and no dump of it where a library ends us."""
    try:
        import resource  # noqa: PLC0415  (not on Windows)
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (free := available_bytes()) is not None:
        most = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = free + _ROOM
        resource.setrlimit(resource.RLIMIT_AS, (wanted if most < 0 else min(wanted, most), most))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None, [int(word) for word in sys.argv[3:]])
