"""The files of a mesh in motion, one a frame, in the order of their numbers."""

from __future__ import annotations

import os
import re
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.mesh_files import SUFFIXES as MESHES
from render.files.naming import natural, natural_sort
from render.files.point_caches import SUFFIXES as CACHES

# STL, whose vertices have no order, is read where none of these is there.
FRAMES = (".obj", ".ply", ".glb")
_SIGNS = "*?["


def is_pattern(path: Path) -> bool:
    """Whether a path means several files: it has signs of a pattern in its name, and nothing is called exactly so."""
    return any(sign in path.name for sign in _SIGNS) and not os.path.lexists(path)


def frame_files(source: Path) -> list[Path]:
    """The files of the frames in their order: by the last number in their names, by its value.

    Args:
        source: a folder of mesh files, a pattern of such files (its last part; folders are called as they are), or one
            mesh file.

    Raises:
        InputError: no such folder, no mesh files, several kinds of names or endings, numbers that are missing, or one
            number twice.
    """
    pattern = is_pattern(source)
    if not pattern and not source.is_dir():
        if source.suffix.lower() in MESHES:
            return [source]
        what = "a folder of OBJ, PLY or GLB frames, a pattern such as FOLDER/shirt_*.obj, or a point cache"
        raise InputError(f"{source}: no such folder; wanted is {what} ({', '.join(CACHES)})")
    entries = source.parent.glob(source.name) if pattern else source.iterdir()
    meshes = [file for file in entries if file.suffix.lower() in MESHES and not file.name.startswith(".")]
    files = natural_sort([file for file in meshes if file.suffix.lower() in FRAMES] or meshes)
    if not files:
        raise InputError(f"{source}: no OBJ, PLY or GLB files here; one a frame is wanted")
    names = {_without_number(file) for file in files}
    if len(names) > 1:
        some = ", ".join(sorted(names, key=natural)[:3])
        raise InputError(
            f"{source}: files of several kinds ({some}); give a pattern for one of them, such as "
            f"'{(source.parent if pattern else source) / sorted(names)[0].replace('#', '*')}'"
        )
    _check_complete(source, files)
    return files


def _without_number(file: Path) -> str:
    return re.sub(r"\d+(?=\D*$)", "#", file.stem, count=1) + file.suffix.lower()


def _check_complete(source: Path, files: list[Path]) -> None:
    if len(files) == 1:
        return
    matches = [re.search(r"(\d+)(?=\D*$)", file.stem) for file in files]
    if any(match is None for match in matches):
        raise InputError(f"{source}: the files' names have no numbers, so their order is not known")
    numbers = [int(match[1]) for match in matches if match is not None]
    steps = np.diff(numbers)
    if (steps == 0).any():
        twice = int(np.argmax(steps == 0))
        raise InputError(f"{source}: {files[twice].name} and {files[twice + 1].name} are the same frame")
    step = int(steps.min())
    # Numbers may be times of day, a year apart: what is missing is never counted through.
    gaps = (number for a, b in pairwise(numbers) for number in range(a + step, b, step))
    missing = list(islice(gaps, 6))
    if missing or (steps % step).any():
        listed = ", ".join(str(number) for number in missing[:5]) + (" ..." if len(missing) > 5 else "")
        raise InputError(
            f"{source}: frames are missing between {files[0].name} and {files[-1].name}: {listed or 'uneven steps'} "
            f"({len(files)} files found)"
        )
