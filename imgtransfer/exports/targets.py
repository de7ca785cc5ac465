"""What an animation can be written as, and whether it can be written there; nothing heavy is imported for it."""

from __future__ import annotations

from pathlib import Path

from render import InputError
from render.extras import check_installed
from render.files.point_caches import SUFFIXES

USD = (".usd", ".usdc", ".usda", ".usdz")
CACHES = tuple(suffix for suffix in SUFFIXES if suffix != ".pc16")
ENDINGS = (".npz", ".glb", *USD, ".abc", *CACHES)
"""Endings of single files; a name without one is a folder with a mesh file a frame."""


def check_target(path: Path) -> None:
    """Say before any work is done whether `written_animation` can write to `path`.

    Raises:
        InputError: an ending that is not known, an extra that is not installed, a folder that is there already, or a
            folder in place of a file, or an OBJ that the one beside a point cache would replace.
    """
    ending = path.suffix.lower()
    if ending and ending not in ENDINGS:
        raise InputError(
            f"{path}: no '{ending}' is written; wanted is a name that ends in {', '.join(ENDINGS)}, or a folder "
            "(a name without a dot) for one OBJ or PLY file a frame"
        )
    if not ending and path.exists():
        raise InputError(f"{path}: exists already; give the name of a new folder")
    if ending and path.is_dir():
        raise InputError(f"{path}: is a folder; wanted is the name of a {ending} file")
    if ending in CACHES:
        for name in (path, path.with_name(f"{path.stem}_body{path.suffix}")):
            beside = name.with_suffix(".obj")
            if beside.exists() and not name.exists():  # not from an earlier export
                raise InputError(
                    f"{beside}: exists already and would be replaced by the mesh that {name.name} moves; choose "
                    "another name"
                )
    if ending in USD:
        check_installed("usd", f"{path}: writing USD", "pxr")
    if ending == ".abc":
        check_installed("alembic", f"{path}: writing Alembic", "alembic3d")
