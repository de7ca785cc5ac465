"""What a data set's metadata hold, and in which versions."""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from imgtransfer.data.clip import PER_FRAME, SKINNING, SURFACE
from imgtransfer.data.place import METADATA, Place
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


def check_name(name: str, split: str) -> None:
    """Raise InputError unless a clip can be stored under this name and in this split."""
    if not re.fullmatch(r"[\w-][\w.-]*/[\w-][\w.-]*", name):
        raise InputError(f"clip name {name!r}: wanted <garment>/<clip> of letters, digits, '_', '-' and '.'")
    if not split:
        raise InputError(f"clip {name}: it needs a split, such as train or test")


def versions() -> dict[str, str]:
    """Versions of what writes data, for the record."""
    return {"python": platform.python_version()} | {
        package: version(package) for package in ("imgtransfer", "numpy", "zarr")
    }


def read_attributes(place: Place, key: str, where: str) -> dict[str, Any]:
    """Attributes of a group, read as plain JSON so that a damaged file gives one clear line.

    Args:
        key: of the group, "" for the root. where: path or URL of the data set, for messages.
    """
    return read_all_attributes(place, [key], where)[0]


def read_all_attributes(place: Place, keys: Sequence[str], where: str) -> list[dict[str, Any]]:
    """`read_attributes` of many groups, fetched together."""
    files = [f"{key}/{METADATA}" if key else METADATA for key in keys]
    try:
        contents = place.read_many(files)
    except OSError as error:
        raise InputError(f"{where}: metadata cannot be read ({error})") from error
    return [_attributes(content, f"{where}/{file}") for file, content in zip(files, contents, strict=True)]


def _attributes(content: bytes, where: str) -> dict[str, Any]:
    try:
        return dict(json.loads(content)["attributes"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{where}: not the metadata of a Zarr v3 group ({error})") from error


def check_root(attributes: dict[str, Any], where: str) -> None:
    """Raise InputError unless root attributes are those of a data set that this program reads."""
    if attributes.get("format") != FORMAT:
        raise InputError(
            f"{where}: a Zarr store, but its format is {attributes.get('format')!r}, not {FORMAT!r}"
        )
    found = attributes.get("schema_version")
    if found not in READABLE:
        raise InputError(
            f"{where}: data set of schema version {found}, but this program reads versions "
            f"{' and '.join(map(str, READABLE))}; use the version of imgtransfer that wrote it, or a later one"
        )
