"""What a data set's metadata hold, and in which versions."""

from __future__ import annotations

import platform
import re
from importlib.metadata import version
from typing import Any

from imgtransfer.data.clip_parts import PER_FRAME, SKINNING, SURFACE
from render import InputError

FORMAT, SCHEMA_VERSION = "imgtransfer-dataset", 2
READABLE = (1, SCHEMA_VERSION)
STATIC = ("template_vertices", "garment_faces", "body_rest", "body_faces")
ARRAYS = tuple(dict.fromkeys((*STATIC, *PER_FRAME, *SKINNING, *SURFACE)))  # every array of a clip, once
REQUIRED_ARRAYS = (*STATIC, "body_vertices")
NEVER_ZERO = (
    "template_vertices",
    "garment_faces",
    "body_rest",
    "body_faces",
    "garment_vertices",
    "body_vertices",
)


def is_plain(name: str) -> bool:
    """Whether a text can be a clip's name: "<garment>/<clip>", nothing that means another folder to a file system."""
    return re.fullmatch(r"[\w-][\w.-]*/[\w-][\w.-]*", name) is not None


def check_name(name: str, split: str) -> None:
    """Raise InputError unless a clip can be stored under this name and in this split."""
    if not is_plain(name):
        raise InputError(f"clip name {name!r}: wanted <garment>/<clip> of letters, digits, '_', '-' and '.'")
    if not split:
        raise InputError(f"clip {name}: it needs a split, such as train or test")


def valid_clip_name(garment: str, clip: str) -> str:
    """ "<garment>/<clip>", in which only the characters are left that names in a data set may have."""
    clean = [re.sub(r"[^\w.-]+", "-", part).strip("-.") or "clip" for part in (garment, clip)]
    return "/".join(clean)


def versions() -> dict[str, str]:
    """Versions of what writes data, for the record."""
    return {"python": platform.python_version()} | {
        package: version(package) for package in ("imgtransfer", "numpy", "zarr")
    }


def check_root(attributes: dict[str, Any], where: str) -> None:
    """Raise InputError unless root attributes are those of a data set that this program reads."""
    if attributes.get("format") != FORMAT:
        raise InputError(
            f"{where}: a Zarr store, but its format is {str(attributes.get('format'))[:80]!r}, not {FORMAT!r}"
        )
    schema_version = attributes.get("schema_version")
    if not (isinstance(schema_version, int) and schema_version in READABLE):
        raise InputError(
            f"{where}: data set of schema version {str(schema_version)[:80]}, but this program reads versions "
            f"{' and '.join(map(str, READABLE))}; use the version of imgtransfer that wrote it, or a later one"
        )
