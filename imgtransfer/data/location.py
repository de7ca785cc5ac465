"""Where a data set lies: a local folder, or a place that fsspec reaches (s3://, gs://, https://, memory://)."""

from __future__ import annotations

import re
from pathlib import Path

from imgtransfer.data.local_place import LocalPlace
from imgtransfer.data.place import Place
from imgtransfer.data.remote_place import RemotePlace


def place_at(source: str | Path) -> Place:
    """The place that a path or URL names.

    Raises:
        InputError: a URL of a kind that fsspec does not know, or whose package is missing.
    """
    url = as_url(source)
    if url is None:
        return LocalPlace(Path(re.sub(r"^file:/+", "/", str(source))))
    return RemotePlace.at(url)


def as_url(source: str | Path) -> str | None:
    """The URL that `source` is; None for a local path, as file:// URLs are, too.

    `Path("s3://bucket/x")` is "s3:/bucket/x", so one slash after a scheme of two letters or more is taken for two.
    """
    text = str(source)
    if not re.match(r"[A-Za-z][\w+.-]+:[:/]", text) or text.startswith("file:"):
        return None
    return re.sub(r"(?<=\w):/(?!/)", "://", text).rstrip("/")


def everywhere(source: str | Path) -> str | Path:
    """The same place as processes with another working folder must name it: URLs as they are, paths absolute."""
    return as_url(source) or Path(source).resolve()
