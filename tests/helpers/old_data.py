"""Data sets as earlier versions wrote them."""

from __future__ import annotations

import json

from imgtransfer.data.place import group_metadata
from imgtransfer.data.store import DataSet


def as_version_1(data: DataSet) -> None:
    """Take from a version-2 data set what version 1 did not have; its arrays keep their encoding."""
    root = dict(data.attributes) | {"schema_version": 1}
    (data.path / "zarr.json").write_bytes(group_metadata(root))
    for name in data.names():
        attributes = json.loads((data.path / name / "zarr.json").read_text())["attributes"]
        kept = ("name", "split", "fps", "frames", "source", "licence", "info")
        (data.path / name / "zarr.json").write_bytes(group_metadata({key: attributes[key] for key in kept}))
