"""The folder that `imgtransfer predict` writes, `fuse` adds to and `evaluate` reads: one folder a clip."""

from __future__ import annotations

from pathlib import Path

from render import InputError, Option
from render.files.temporaries import clear, put_back

METHODS = ("fused", "position_only")  # of vertices, the better first; each a clip npz METHOD.npz
FUSED_FILE, POSITION_ONLY_FILE = (f"{method}.npz" for method in METHODS)
MAPS_FILE, REPORT_FILE, HISTORY_FILE, MESHES_FOLDER = "maps.npz", "fusion.json", "history.png", "meshes"
TEXTURES_FOLDER = "textures"  # as `imgtransfer.data.texture_files` names it
WRITTEN = frozenset(
    {
        MAPS_FILE,
        POSITION_ONLY_FILE,
        FUSED_FILE,
        REPORT_FILE,
        HISTORY_FILE,
        MESHES_FOLDER,
        TEXTURES_FOLDER,
    }
)


def folder_of_clip(name: str) -> str:
    """The name of the folder that holds what is made from a clip: "tshirt/walk" -> "tshirt__walk"."""
    return name.replace("/", "__")


def clip_of_folder(name: str) -> str:
    """The inverse of `folder_of_clip`."""
    return name.replace("__", "/")


def folders_in(path: Path) -> list[Path]:
    """`path` itself, and the folders in it, sorted; not those under way, whose names start with a dot."""
    inner = (entry for entry in path.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    return [path, *sorted(inner)]


def predicted_clips(path: Path) -> list[Path]:
    """The clips' folders in what `imgtransfer predict` wrote to `path`, or `path` itself if it is one of them.

    Raises:
        InputError: no such folder, no prediction in it, or one without its body.
    """
    clear(path)
    if not path.is_dir():
        single = f"; for a map file of another program give {Option('maps')} FILE {Option('out')} DIR"
        hint = single if path.is_file() else ""
        raise InputError(f"{path}: no such folder; what `imgtransfer predict` wrote is wanted{hint}")
    put_back(path, holding=MAPS_FILE)
    clips = [folder for folder in folders_in(path) if (folder / MAPS_FILE).is_file()]
    if not clips:
        raise InputError(f"{path}: no prediction in it; wanted are folders with {MAPS_FILE}")
    for folder in clips:
        if not (folder / POSITION_ONLY_FILE).is_file():
            raise InputError(f"{folder}: lacks {POSITION_ONLY_FILE}, which holds the body; predict again")
    return clips


def check_replaceable(folder: Path) -> None:
    """Refuse to replace a folder for results that holds anything but earlier results.

    Raises:
        InputError: it is a file, or holds other files.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{Option('out')} {folder}: is a file; name a folder")
    if folder.exists() and any(entry.name not in WRITTEN for entry in folder.iterdir()):
        raise InputError(
            f"{Option('out')} {folder}: holds other files, which would be lost; name another folder"
        )
