"""The images that a material library names, brought along with meshes that use it."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable
from pathlib import Path

from render.files.textures import change_paths, is_image

STORED = "textures"  # folder beside a clip npz, or in a data set


def bring_textures(mtl: str, folder: Path) -> tuple[str, list[str]]:
    """Copy the textures of a material library into a folder.

    Args:
        mtl: the library's text, with full paths to textures as `render.files.textures` leaves them.
        folder: that the library is written into; it is there.

    Returns:
        The text with the images' bare names, by which programs look for them beside the library; and the paths of those
        that could not be found (or are no images), each once.
    """
    names: dict[str, str] = {}  # by path as the library has it
    missing: dict[str, None] = {}

    def copied(path: str) -> str | None:
        if not Path(path).is_absolute():
            return None
        if path not in names:
            names[path] = _free_name(Path(path).name, set(names.values()))
            if is_image(Path(path)):
                shutil.copyfile(path, folder / names[path])
            else:
                missing[path] = None
        return names[path]

    def bare(path: str) -> str | None:
        if path in names.values():
            return path
        if " " in path:
            return None
        missing[path] = None
        return Path(path).name

    return change_paths(change_paths(mtl, copied), bare), list(missing)


def store_textures(mtl: str, write: Callable[[str, bytes], object]) -> str:
    """The text with its images' places in a store, where each is kept once; those that are none stay named as they are.

    Args:
        mtl: the library's text, with full paths.
        write: called with a place, "textures/<mark>/<name>", and the content.
    """
    places: dict[str, str] = {}

    def stored(path: str) -> str | None:
        if path not in places and Path(path).is_absolute() and is_image(Path(path)):
            content = Path(path).read_bytes()
            mark = hashlib.sha256(content).hexdigest()[:16]
            places[path] = f"{STORED}/{mark}/{re.sub(r'[^A-Za-z0-9_.-]+', '-', Path(path).name)}"
            write(places[path], content)
        return places.get(path)

    return change_paths(mtl, stored)


def _free_name(name: str, taken: set[str]) -> str:
    """The name, or where another image has it name-2, name-3 and so on."""
    stem, suffix = Path(name).stem, Path(name).suffix
    number, free = 1, name
    while free.lower() in {other.lower() for other in taken}:
        number += 1
        free = f"{stem}-{number}{suffix}"
    return free
