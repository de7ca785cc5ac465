"""Material libraries (MTL) beside an OBJ file; the `map_*` statements name texture images."""

from __future__ import annotations

import re
from pathlib import Path, PurePath

from render.files.text_lines import as_text, plain_lines
from render.files.textures import is_absolute, mtl_lines, path_tails, with_full_paths


def library_text(folder: Path, named: list[bytes]) -> str:
    """The text of material libraries, with full paths to the textures in the mesh's folder; "" where all are missing.

    Textures are named from the library's folder, or from the mesh's. Only files that are named as libraries are read:
    an OBJ file may name any file.

    Args:
        folder: of the mesh. named: what its `mtllib` lines say: one name that may have spaces, or several.
    """
    files = dict.fromkeys(file for name in dict.fromkeys(named) for file in _files(folder, name))
    texts = {file: as_text(plain_lines(file.read_bytes())) for file in files}
    return "".join(
        with_full_paths(with_full_paths(text, file.parent), folder) for file, text in texts.items()
    )


def _files(folder: Path, name: bytes) -> list[Path]:
    text = name.decode("utf-8", errors="surrogateescape").replace("\\", "/").strip('"')
    whole = _library(folder, text) or (_library(folder, PurePath(text).name) if is_absolute(text) else None)
    if whole is not None:
        return [whole]
    several = (_library(folder, part) for part in re.findall(r"\S.*?\.mtl(?=\s|$)", text, re.IGNORECASE))
    return [file for file in several if file is not None]


def _library(folder: Path, name: str) -> Path | None:
    """The file, also where its name differs in the case of letters: on the systems of most exporters it is the same."""
    path = folder / name
    try:
        if path.suffix.lower() != ".mtl":
            return None
        if path.is_file():
            return path
        alike = (file for file in path.parent.iterdir() if file.name.lower() == path.name.lower())
        return next((file for file in sorted(alike) if file.is_file()), None)
    except (OSError, ValueError):  # too long, a zero byte, no such folder
        return None


def in_library(names: list[str], mtl: str) -> list[str]:
    """Names as the library has them: `red # of wool` is `red`, unless a material is called so."""
    known = {
        line.split(None, 1)[1].strip()
        for line in mtl_lines(mtl)
        if line.split()[:1] == ["newmtl"] and line.split()[1:]
    }
    short = {name: re.split(r"\s#", name)[0].strip() for name in names if "#" in name}
    return [
        short[name] if name in short and name not in known and short[name] in known else name
        for name in names
    ]


def textures(mtl: str, keyword: str = "map_Kd") -> list[str]:
    """The images that a material library's lines of a keyword name, each once; full paths may have spaces."""
    images = []
    for line in mtl_lines(mtl):
        first, tails = path_tails(line)
        if first.lower() == keyword.lower() and tails:
            paths = [line[tail:].rstrip(" \t") for tail in tails]
            images.append(next((path for path in paths if Path(path).is_absolute()), paths[-1]))
    return list(dict.fromkeys(images))
