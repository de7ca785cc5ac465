"""What the paths given to a simulation are: motion files, or body mesh sequences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from imgtransfer.importers.mesh_files import moving_in
from imgtransfer.motions.files import SUFFIXES as MOTIONS
from render import InputError
from render.files.frame_files import FRAMES
from render.files.naming import natural_sort
from render.files.point_caches import SUFFIXES as CACHES

_WANTED = (
    "wanted are motion files (npz in the style of AMASS, or BVH), or body mesh sequences: folders with body/ of OBJ or "
    "PLY frames, body_0000.obj and so on, or body.pc2 (.mdd, .pc16)"
)


def sorted_sources(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Motion files, and folders of one body mesh sequence each; folders of either are looked into.

    Raises:
        InputError: nothing at a path, or something else; the message says what was found.
    """
    motions: list[Path] = []
    sequences: list[Path] = []
    for path in paths:
        if not path.is_dir():
            motions.append(_motion_file(path))
            continue
        entries = natural_sort(entry for entry in path.iterdir() if not entry.name.startswith("."))
        moved = sorted(entry for entry in entries if entry.suffix.lower() in MOTIONS and entry.is_file())
        bodies = [path] if has_body(path) else [entry for entry in entries if has_body(entry)]
        if moved and bodies:
            raise InputError(
                f"{path}: {len(moved)} motion files ({moved[0].name}) and {len(bodies)} body mesh sequences "
                f"({bodies[0].name}) in one folder; give the files, or the sequence's folder, by name"
            )
        if not (moved or bodies):
            raise InputError(
                f"{path}: no motion file in this folder, and no body mesh sequence; {_WANTED}; found "
                f"{_contents(entries)}"
            )
        motions += moved
        sequences += bodies
    return motions, sequences


def has_body(folder: Path) -> bool:
    """Whether a folder holds a moving body as `imgtransfer import meshes` reads it."""
    found = moving_in(folder, "body") if folder.is_dir() else None
    if found is None or not found.is_dir():
        return found is not None
    return any(file.suffix.lower() in FRAMES for file in found.iterdir())


def _motion_file(path: Path) -> Path:
    suffix = path.suffix.lower()
    if suffix in MOTIONS:
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
