"""Paths of images in material libraries (MTL). One comes from anywhere and must not lead to other people's files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path, PureWindowsPath

_KEYWORDS = ("map_", "bump", "disp", "norm", "decal", "refl")
IMAGES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".dds")
_LARGEST = 1 << 28  # bytes
_STARTS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM", b"II*\0", b"MM\0*", b"v/1\x01", b"#?", b"DDS ")


def change_paths(mtl: str, change: Callable[[str], str | None]) -> str:
    """The text with other paths of images.

    Args:
        mtl: the library.
        change: called with what may be the path, the longest first (options come before it, and it may have spaces),
            until it returns the new path; where it returns None for all of them, the line stays.
    """
    return "".join(f"{_changed(line, change)}\n" for line in mtl_lines(mtl))


def mtl_lines(mtl: str) -> list[str]:
    """The lines of a library, which a line feed ends: names may hold what Unicode takes for other line ends."""
    return mtl.removesuffix("\n").split("\n") if mtl else []


def path_tails(line: str) -> tuple[str, list[int]]:
    """The keyword of a line, and where what may be the path begins, the longest first."""
    line = line.rstrip(" \t")
    words = list(re.finditer(r"[^ \t]+", line))
    return (words[0][0] if words else ""), [word.start() for word in words[1:]]


def _changed(line: str, change: Callable[[str], str | None]) -> str:
    keyword, tails = path_tails(line)
    if keyword.lower().startswith(_KEYWORDS):
        for start in tails:
            path = change(line[start:].rstrip(" \t"))
            if path is not None:
                return " ".join([keyword, *line[tails[0] : start].split(), path])
    return line


def with_full_paths(mtl: str, folder: Path | None) -> str:
    """The text with full paths to those images that are there, and bare names for all other full paths.

    A full path of another machine means the image of its name in the folder.

    Args:
        mtl: a library from a file.
        folder: under which its images must be, links followed; None finds none.
    """

    def found(path: str) -> str | None:
        image = None if folder is None else image_under(folder, path)
        if image is None and folder is not None and is_absolute(path):
            image = image_under(folder, PureWindowsPath(path).name)
        return None if image is None else str(image)

    def bare(path: str) -> str | None:
        allowed = folder is not None and image_under(folder, path) is not None
        return PureWindowsPath(path).name if is_absolute(path) and not allowed else None

    return change_paths(change_paths(mtl, found), bare)


def is_absolute(path: str) -> bool:
    """Whether a path is a full one, here or under Windows."""
    return Path(path).is_absolute() or PureWindowsPath(path).is_absolute()


def image_under(folder: Path, path: str) -> Path | None:
    """The file that a path names, relative to a folder or in full, if it is named as an image and under the folder."""
    try:
        image = (folder / path).resolve()
        if "\\" in path and not image.is_file():  # as Windows parts folders
            image = (folder / path.replace("\\", "/")).resolve()
        named = Path(path).suffix.lower() in IMAGES and image.suffix.lower() in IMAGES
        return image if named and image.is_relative_to(folder.resolve()) and image.is_file() else None
    except (OSError, ValueError, RuntimeError):  # too long, a zero byte, links in a circle
        return None


def is_image(path: Path) -> bool:
    """Whether a file begins as images do, and is no larger than they are."""
    try:
        if not path.is_file() or not 0 < path.stat().st_size <= _LARGEST:
            return False
        with path.open("rb") as file:
            start = file.read(18)
    except OSError:
        return False
    if path.suffix.lower() == ".tga":  # no mark: a kind of picture, its colour map and bits a pixel
        known = len(start) == 18 and start[1] <= 1 and start[2] in (1, 2, 3, 9, 10, 11)
        return known and start[16] in (8, 15, 16, 24, 32)
    return start.startswith(_STARTS) or (start[:4] == b"RIFF" and start[8:12] == b"WEBP")
