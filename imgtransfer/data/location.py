"""Where a data set lies: a folder or zip file, here or where fsspec reaches (s3://, gs://, https://, memory://)."""

from __future__ import annotations

import re
from pathlib import Path

from imgtransfer.data.local_place import LocalFile, LocalPlace
from imgtransfer.data.place import Place
from imgtransfer.data.remote_place import RemoteFile, RemotePlace
from imgtransfer.data.zip_place import ZipPlace

_ZIP = re.compile(r"\.zip([?#].*)?$", re.IGNORECASE)


def place_at(source: str | Path) -> Place:
    """The place that a path or URL names; one that ends in .zip and is no local folder is a zip file.

    Raises:
        InputError: a URL of a kind that fsspec does not know, or whose package is missing.
    """
    url = as_url(source)
    if url is None:
        path = Path(re.sub(r"^file:/+", "/", str(source)))
        return ZipPlace(LocalFile(path)) if _ZIP.search(path.name) and not path.is_dir() else LocalPlace(path)
    place = RemotePlace.at(url)
    return ZipPlace(RemoteFile(place)) if _ZIP.search(url) and not url.startswith("zip:") else place


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
