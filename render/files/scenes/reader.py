"""Meshes in motion from Alembic and USD files, whose libraries work in a process of their own."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np

import render
from render.errors import InputError
from render.extras import check_installed
from render.files.data_file import check_data_file
from render.files.scenes.process import FAULT
from render.limits import FARTHEST_IN_FILES
from render.memory import check_memory
from render.mesh.file_axes import FileAxes
from render.mesh.mesh import Mesh, check_finite
from render.mesh.sequence import MeshSequence
from render.mesh.surface import Surface
from render.options import Option

log = logging.getLogger(__name__)

_PACKAGES = {".abc": ("alembic", "alembic3d")} | dict.fromkeys(
    (".usd", ".usda", ".usdc", ".usdz"), ("usd", "pxr")
)  # by suffix: the extra, and what is imported of it
SUFFIXES = tuple(_PACKAGES)
_LISTED = 12  # objects that a message names
_ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}  # points are placed faster by one than by several


def is_scene(path: Path) -> bool:
    """Whether a path is that of an Alembic or USD file."""
    return path.suffix.lower() in SUFFIXES and not path.is_dir()


def open_scene(path: Path, which: Option) -> MeshSequence:
    """One mesh of a scene file in motion, with the transforms of all its parents; its first frame is read.

    Args:
        path: .abc, .usd, .usda, .usdc or .usdz.
        which: the option that chooses among several meshes, with the name or path of one as its value; None takes
            the only one.

    Returns:
        Frames at the file's own samples; where these are uneven, resampled on straight lines to its frame rate, which
        is logged. Coordinates are the file's; its mesh says which axes and unit these are, where the file does.

    Raises:
        InputError: no such file, the package that reads it is missing, a damaged file, no mesh or several, or one that
            cannot be a mesh sequence. When frames are read: a mesh that changes, or values not finite.
    """
    suffix = path.suffix.lower()
    extra, package = _PACKAGES[suffix]
    check_data_file(path, f"a scene file ({suffix})", whole=False)
    check_installed(extra, f"{path}: reading {suffix}", package)
    facts = path.stat()
    mesh, header = _first(path, which, (facts.st_ino, facts.st_mtime_ns, facts.st_size))
    n_frames = int(header["frames"])

    def parts(count: int) -> Iterator[np.ndarray]:
        check_memory(12 * len(mesh.vertices) * min(count, n_frames), f"{path}: {min(count, n_frames)} frames")
        with _answer(path, header["path"]) as (_, answer):
            _arrays(path, header, answer)
            for start in range(0, n_frames, count):
                yield _frames(answer, mesh, range(start, min(start + count, n_frames)))

    def read_frames(numbers: Sequence[int]) -> np.ndarray:
        with _answer(path, header["path"], numbers) as (_, answer):
            _arrays(path, header, answer)
            return np.concatenate([_frames(answer, mesh, range(number, number + 1)) for number in numbers])

    return MeshSequence(
        mesh, n_frames, parts, str(path), header["fps"], read_frames=read_frames, start=header["start"]
    )


@lru_cache(maxsize=4)
def _first(path: Path, which: Option, version: tuple[int, ...]) -> tuple[Mesh, dict[str, Any]]:
    """The mesh in its first frame, and what the process says of it; kept, because commands open files several times."""
    del version  # with another one it is another file
    shown = str(path)
    with _answer(path, None if which.value is None else str(which.value)) as (header, answer):
        if "names" in header:
            raise InputError(_choice(shown, header, which))
        arrays = _arrays(path, header, answer)
    source = f"{shown}: {header['path']}"
    axes = None if header["up"] is None else _axes(shown, header)
    mesh = Mesh(arrays["vertices"], arrays["faces"], source, axes=axes)
    if header["note"]:
        log.info("%s", header["note"])
    textured, materials = bool(len(arrays["uvs"])), tuple(header["materials"])
    if not (textured or materials):
        return mesh, header
    surface = Surface(
        mesh.faces,
        np.arange(len(mesh.vertices)),
        uvs=arrays["uvs"] if textured else None,
        uv_faces=arrays["uv_faces"] if textured else None,
        face_materials=arrays["face_materials"] if materials else None,
        materials=materials,
    )
    return Mesh(mesh.vertices, mesh.faces, source, surface, axes), header


def _axes(shown: str, header: dict[str, Any]) -> FileAxes:
    try:
        return FileAxes(header["up"], header["metres"])
    except InputError as error:
        raise InputError(f"{shown}: {error}") from None


def _choice(shown: str, header: dict[str, Any], which: Option) -> str:
    """What is said where a file has not exactly one mesh of the wanted name."""
    names = header["chosen"] or header["names"]
    some = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
    if not header["names"]:
        return f"{shown}: no mesh in this scene; polygons are wanted, no curves, points or volumes"
    if which.value is not None and not header["chosen"]:
        return f"{shown}: {which}: no such object; it has {some}"
    if not header["seen"]:
        return (
            f"{shown}: its meshes are hidden or no final ones ({some}); choose one with {Option(which.name)}"
        )
    return f"{shown}: {len(names)} meshes ({some}); choose one with {Option(which.name)}"


@contextmanager
def _answer(
    path: Path, name: str | None, frames: Sequence[int] = ()
) -> Iterator[tuple[dict[str, Any], IO[bytes]]]:
    """The header of what the reading process says, and what follows: all frames, or those that are named.

    The process ends with the block.
    """
    command = [
        sys.executable,
        "-m",
        "render.files.scenes.process",
        str(path),
        *([] if name is None else [name]),
        *map(str, frames),
    ]
    above = [str(Path(render.__file__).parent.parent), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, above)), **_ONE_THREAD}
    with subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        assert process.stdout is not None
        try:
            yield _line(process.stdout), process.stdout
        except _EndedError:
            code = process.wait()
            reason = signal.Signals(-code).name if code < 0 else f"exit status {code}"
            raise InputError(
                f"{path}: cannot be read, is it damaged? The program that reads it ended ({reason})"
            ) from None
        finally:
            process.kill()


class _EndedError(Exception):
    """The reading process ended before it had said all."""


def _arrays(path: Path, header: dict[str, Any], answer: IO[bytes]) -> dict[str, np.ndarray]:
    arrays = {}
    for name in ("vertices", "faces", "uvs", "uv_faces", "face_materials"):
        kind, shape = np.dtype(header[name][0]), tuple(header[name][1])
        size = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
        check_memory(size, f"{path}: the {name} of its mesh")
        arrays[name] = np.frombuffer(bytearray(_exactly(answer, size)), kind).reshape(shape)  # writable
    return arrays


def _frames(answer: IO[bytes], mesh: Mesh, numbers: range) -> np.ndarray:
    """(t, N, 3) float32 of the next frames, which have these numbers."""
    vertices = np.empty((len(numbers), len(mesh.vertices), 3), np.float32)
    for row in range(len(vertices)):
        if _exactly(answer, 1) == FAULT:
            _line(answer)
        vertices[row] = np.frombuffer(_exactly(answer, vertices[row].nbytes), "<f4").reshape(-1, 3)
    check_finite(vertices, mesh.source, limit=FARTHEST_IN_FILES, unit="", first=numbers.start)
    return vertices


def _line(answer: IO[bytes]) -> dict[str, Any]:
    """A line of JSON; InputError where it says what is wrong."""
    line = answer.readline()
    if not line.endswith(b"\n"):
        raise _EndedError
    said: dict[str, Any] = json.loads(line)
    if "error" in said:
        raise InputError(said["error"])
    return said


def _exactly(answer: IO[bytes], size: int) -> bytes:
    content = answer.read(size)
    if len(content) < size:
        raise _EndedError
    return content
