"""The images that a material library names, brought along with meshes that use it."""

from __future__ import annotations

import shutil
from pathlib import Path

# A library comes with its data set, maybe from elsewhere: it must not make us copy what is no image.
IMAGES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".dds")
_KEYWORDS = ("map_", "bump", "disp", "norm")


def bring_textures(mtl: str, folder: Path) -> tuple[str, list[str]]:
    """Copy the textures of a material library into a folder.

    Args:
        mtl: the library's text, with full paths to textures as `render.objfile` leaves them.
        folder: that the library is written into; it is there.

    Returns:
        The text with the images' bare names, by which programs look for them beside the library; and the paths of those
        that could not be found (or are no images), each once.
    """
    names: dict[str, str] = {}  # by path as the library has it
    missing: dict[str, None] = {}
    lines = []
    for line in mtl.splitlines():
        keyword, *words = line.split() or [""]
        if not (keyword.startswith(_KEYWORDS) and words):
            lines.append(line)
            continue
        start = next(
            (n for n in range(len(words)) if Path(" ".join(words[n:])).is_absolute()), len(words) - 1
        )
        path = " ".join(words[start:])
        if path not in names:
            names[path] = _free_name(Path(path).name, set(names.values()))
            if Path(path).is_absolute() and Path(path).suffix.lower() in IMAGES and Path(path).is_file():
                shutil.copyfile(path, folder / names[path])
            else:
                missing[path] = None
        lines.append(" ".join([keyword, *words[:start], names[path]]))
    return "".join(f"{line}\n" for line in lines), list(missing)


def _free_name(name: str, taken: set[str]) -> str:
    """The name, or where another image has it name-2, name-3 and so on."""
    stem, suffix = Path(name).stem, Path(name).suffix
    number, free = 1, name
    while free.lower() in {other.lower() for other in taken}:
        number += 1
        free = f"{stem}-{number}{suffix}"
    return free
