"""The images that a material library names, brought along with meshes that use it."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable
from pathlib import Path

from render.files.atomic import written_whole
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
            places[path] = store_texture(Path(path), write)
        return places.get(path)

    return change_paths(mtl, stored)


def store_texture(image: Path, write: Callable[[str, bytes], object]) -> str:
    """Write one image to its place in a store, "textures/<mark>/<name>", which is returned; arguments as above."""
    content = image.read_bytes()
    mark = hashlib.sha256(content).hexdigest()[:16]
    place = f"{STORED}/{mark}/{re.sub(r'[^A-Za-z0-9_.-]+', '-', image.name)}"
    write(place, content)
    return place


def writer_into(folder: Path) -> Callable[[str, bytes], None]:
    """What writes a place in a store that is a folder."""

    def write(place: str, content: bytes) -> None:
        with written_whole(folder / place) as temporary:
            temporary.write_bytes(content)

    return write


def _free_name(name: str, taken: set[str]) -> str:
    """The name, or where another image has it name-2, name-3 and so on."""
    stem, suffix = Path(name).stem, Path(name).suffix
    number, free = 1, name
    while free.lower() in {other.lower() for other in taken}:
        number += 1
        free = f"{stem}-{number}{suffix}"
    return free
