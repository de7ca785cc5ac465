"""The files of a mesh in motion, one a frame, in the order of their numbers."""

from __future__ import annotations

import os
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from render.errors import InputError
from render.files.frame_names import sequences_of
from render.files.mesh_files import SUFFIXES as MESHES
from render.files.point_caches import SUFFIXES as CACHES
from render.files.scenes.reader import SUFFIXES as SCENES

# Scenes, which may lie beside the frames of theirs, are read where none of these is there, and STL, whose vertices have
# no order, where there is no scene either.
_MESH_FRAMES = (".obj", ".ply", ".glb", ".gltf")
FRAMES = (*_MESH_FRAMES, *SCENES)
REST_NAMES = ("template", "body_rest", "rest", "rest_pose")  # without suffix
_SIGNS = "*?["


def is_pattern(path: Path) -> bool:
    """Whether a path means several files: it has signs of a pattern in its name, and nothing is called exactly so."""
    return any(sign in path.name for sign in _SIGNS) and not os.path.lexists(path)


def frame_files(source: Path) -> list[Path]:
    """The files of the frames in their order: by the number in their names that differs, by its value; it may be
    negative, and padded or not.

    Args:
        source: a folder of mesh files, of which one called as a rest pose is left out; a pattern of such files (its
            last part; folders are called as they are), or one mesh file.

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
    visible = [file for file in entries if not file.name.startswith(".")]
    kinds = (
        [file for file in visible if file.suffix.lower() in kind] for kind in (_MESH_FRAMES, SCENES, MESHES)
    )
    files = next(filter(None, kinds), [])
    if not files:
        raise InputError(f"{source}: no OBJ, PLY or GLB files here; one a frame is wanted")
    numbered = [file for file in files if not is_rest_name(file)]
    return _in_order(source, numbered or files)


def is_rest_name(file: Path) -> bool:
    """Whether a file is called as a rest pose is, which may lie among the frames and is none of them."""
    return file.stem.lower() in REST_NAMES


def _in_order(source: Path, files: list[Path]) -> list[Path]:
    """The files by their frames' numbers.

    Raises:
        InputError: as `frame_files`.
    """
    sequences = sequences_of(files)
    if len(sequences) > 1:
        folder = source.parent if is_pattern(source) else source
        some = ", ".join(sequence.title for sequence in sequences[:3])
        wanted = next((sequence for sequence in sequences if len(sequence.names) > 1), sequences[0])
        raise InputError(
            f"{source}: files of several kinds ({some}); give a pattern for one of them, such as "
            f"'{folder / wanted.pattern(sequences)}'"
        )
    names, column = sequences[0].names, sequences[0].column
    if len(names) == 1:
        return files
    if column is None:
        raise InputError(f"{source}: the files' names have no numbers, so their order is not known")
    numbers = {name.file: name.numbers[column] for name in names}
    files = sorted(files, key=lambda file: (numbers[file], file.name))
    _check_complete(source, files, [numbers[file] for file in files])
    return files


def _check_complete(source: Path, files: list[Path], numbers: list[int]) -> None:
    """Raise InputError where a number comes twice, or one is missing between the first and the last."""
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
