"""What the paths given to a simulation are: motion files, or body mesh sequences."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imgtransfer.importers.mesh_files import moving_in
from imgtransfer.motions.files import SUFFIXES as MOTIONS
from render import InputError
from render.files.frame_files import FRAMES
from render.files.naming import natural_sort
from render.files.point_caches import SUFFIXES as CACHES
from render.files.scenes.reader import is_scene

_DATA_SETS = (".zarr",)  # with clips of many arrays, none of them a motion file
_WANTED = (
    "wanted are motion files (npz in the style of AMASS, or BVH), or body mesh sequences: folders with body/ of OBJ or "
    "PLY frames, body_0000.obj and so on, body.pc2 (.mdd, .pc16), body.abc or body.usd; or an Alembic or USD file"
)


@dataclass(frozen=True)
class MotionFile:
    """A motion file to simulate.

    Args:
        path: of the file.
        name: what its clips are called, of characters that names in a data set may have.
        listed: whether it was given by name, rather than lying in a given folder.
    """

    path: Path
    name: str
    listed: bool


def sorted_sources(paths: Sequence[Path]) -> tuple[list[MotionFile], list[Path]]:
    """Motion files, and folders of one body mesh sequence each; folders are searched, however deep.

    A motion file in a folder of a given folder is named by both, so that subjects of a data set stay apart.

    Raises:
        InputError: nothing at a path, or something else; the message says what was found.
    """
    motions: list[MotionFile] = []
    sequences: list[Path] = []
    for path in paths:
        if is_scene(path) and path.exists():
            sequences.append(path)
            continue
        if not path.is_dir():
            motions.append(MotionFile(_motion_file(path), _clip_name(Path(path.name)), listed=True))
            continue
        moved, bodies = _searched(path, set())
        if moved and bodies:
            raise InputError(
                f"{path}: {len(moved)} motion files ({moved[0].name}) and {len(bodies)} body mesh sequences "
                f"({bodies[0].name}) in one folder; give the files, or the sequence's folder, by name"
            )
        if not (moved or bodies):
            raise InputError(
                f"{path}: no motion file in this folder, and no body mesh sequence; {_WANTED}; found "
                f"{_contents(_entries(path))}"
            )
        motions += [MotionFile(file, _clip_name(file.relative_to(path)), listed=False) for file in moved]
        sequences += bodies
    return motions, sequences


def _entries(folder: Path) -> list[Path]:
    return natural_sort(entry for entry in folder.iterdir() if not entry.name.startswith("."))


def _searched(folder: Path, seen: set[Path]) -> tuple[list[Path], list[Path]]:
    """Motion files and body mesh sequences in a folder and those within it, but not within a sequence or data set."""
    seen.add(folder.resolve())
    if has_body(folder):
        # What lies beside a body's frames was always taken; what lies below them are its frames.
        return _motions(_entries(folder)), [folder]
    entries = _entries(folder)
    motions, sequences = _motions(entries), []
    for entry in entries:
        if not entry.is_dir() or entry.suffix in _DATA_SETS or entry.resolve() in seen:
            continue
        moved, bodies = _searched(entry, seen)
        motions += moved
        sequences += bodies
    return motions, sequences


def _motions(entries: Sequence[Path]) -> list[Path]:
    return sorted(entry for entry in entries if entry.suffix.lower() in MOTIONS and entry.is_file())


def _clip_name(file: Path) -> str:
    """A file's name, with the folders before it, without suffix and signs that names in a data set cannot have."""
    return re.sub(r"[^\w.-]+", "-", "_".join(file.with_suffix("").parts)).strip("-.") or "clip"


def has_body(folder: Path) -> bool:
    """Whether a folder holds a moving body as `imgtransfer import meshes` reads it."""
    found = moving_in(folder, "body") if folder.is_dir() else None
    if found is None or not found.is_dir():
        return found is not None
    return any(file.suffix.lower() in FRAMES for file in found.iterdir())


def _motion_file(path: Path) -> Path:
    suffix = path.suffix.lower()
    if suffix in MOTIONS and path.exists():
        return path
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; {_WANTED}")
    if suffix in (*CACHES, *FRAMES):
        raise InputError(f"{path}: a body mesh sequence is given by the folder that holds it; {_WANTED}")
    raise InputError(f"{path}: neither a motion file nor a folder; {_WANTED}")


def _contents(entries: list[Path]) -> str:
    """A folder's contents in a few words."""
    folders = [entry.name for entry in entries if entry.is_dir()]
    files = [entry for entry in entries if not entry.is_dir()]
    kinds = Counter(file.suffix.lower() or "no suffix" for file in files).most_common(3)
    parts = [f"{kind} files: {count}" for kind, count in kinds]
    if files:
        parts[0] += f" ({files[0].name}{', ...' if len(files) > 1 else ''})"
    if folders:
        parts.append(f"folders: {', '.join(folders[:3])}{', ...' if len(folders) > 3 else ''}")
    return ", ".join(parts) or "nothing"
