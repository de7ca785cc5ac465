"""The data set on disk: a Zarr v3 store, one group a garment and clip, lossless, written clip by clip."""

from __future__ import annotations

import json
import platform
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec

from imgtransfer.data import grid
from imgtransfer.data.clip import SKINNING, SURFACE, Clip
from render import InputError
from render.files import written_whole_folder

FORMAT, SCHEMA_VERSION = "imgtransfer-dataset", 1
FRAMES_PER_CHUNK = 32
PER_FRAME = ("garment_vertices", "body_vertices", "poses", "trans", "joint_transforms")
STATIC = ("template_vertices", "garment_faces", "body_rest", "body_faces")
ARRAYS = tuple(dict.fromkeys((*STATIC, *PER_FRAME, *SKINNING, *SURFACE)))  # every array of a clip, once


@dataclass(frozen=True)
class DataSet:
    """A folder of clips. Make one with `create`, `open` or `open_or_create`.

    On disk: root attributes `format`, `schema_version`, `units`, `up`, `title`, `source`, `licence` and
    `versions`; groups `<garment>/<clip>` with the arrays of `Clip`, those that change with time chunked by
    32 frames, and
    attributes `name`, `split`, `fps`, `frames`, `source`, `licence`, `info`. Positions that lie on the 2⁻¹⁶ m
    grid of `imgtransfer.data.grid` are stored as differences in time; the reader returns the same float32.

    Args:
        path: the folder.
        attributes: the root attributes.
    """

    path: Path
    attributes: dict[str, Any]

    @classmethod
    def create(cls, path: str | Path, *, title: str = "", licence: str = "", source: str = "") -> DataSet:
        """Make an empty data set.

        Raises:
            InputError: something stands at `path` already.
        """
        path = Path(path)
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise InputError(f"{path}: exists already; a data set is made in a new or empty folder")
        attributes = {
            "format": FORMAT,
            "schema_version": SCHEMA_VERSION,
            "units": "m",
            "up": "y",
            "title": title,
            "source": source,
            "licence": licence,
            "versions": {"python": platform.python_version()}
            | {package: version(package) for package in ("imgtransfer", "numpy", "zarr")},
        }
        with written_whole_folder(path) as temporary:
            zarr.create_group(temporary, zarr_format=3, attributes=attributes)
        return cls(path, attributes)

    @classmethod
    def open(cls, path: str | Path) -> DataSet:
        """Open a data set that exists.

        Raises:
            InputError: no data set at `path`, or one of another schema version.
        """
        path = Path(path)
        if not (path / "zarr.json").is_file():
            raise InputError(
                f"{path}: no data set; wanted is a folder made by `imgtransfer simulate` or `import`"
            )
        attributes = _attributes(path)
        if attributes.get("format") != FORMAT:
            raise InputError(
                f"{path}: a Zarr store, but its format is {attributes.get('format')!r}, not {FORMAT!r}"
            )
        if attributes.get("schema_version") != SCHEMA_VERSION:
            raise InputError(
                f"{path}: data set of schema version {attributes.get('schema_version')}, but this program "
                f"reads version {SCHEMA_VERSION}; export its clips as npz with what wrote it and import them"
            )
        return cls(path, attributes)

    @classmethod
    def open_or_create(
        cls, path: str | Path, *, title: str = "", licence: str = "", source: str = ""
    ) -> DataSet:
        """`open` where something stands at `path`, else `create`."""
        if Path(path).is_dir() and any(Path(path).iterdir()):
            return cls.open(path)
        return cls.create(path, title=title, licence=licence, source=source)

    def names(self, split: str | None = None) -> list[str]:
        """Names of the clips, "<garment>/<clip>", sorted; only those of `split` where one is given."""
        found = sorted(
            f"{file.parts[-3]}/{file.parts[-2]}"
            for file in self.path.glob("*/*/zarr.json")
            if not file.parts[-2].startswith(".")  # one being written
        )
        return [name for name in found if split is None or self.split(name) == split]

    def clip_attributes(self, name: str) -> dict[str, Any]:
        """Attributes of one clip: name, split, fps, frames, source, licence, info.

        Raises:
            InputError: no such clip; the message lists those there are.
        """
        if not (self.path / name / "zarr.json").is_file():
            raise InputError(f"{self.path}: no clip {name!r}; it has {', '.join(self.names()) or 'none'}")
        return _attributes(self.path / name)

    def split(self, name: str) -> str:
        """The split that the clip belongs to, such as "train" or "test"."""
        return str(self.clip_attributes(name)["split"])

    def read(self, name: str) -> Clip:
        """Read one clip; its arrays equal those that were written, bit for bit.

        Raises:
            InputError: no such clip, or arrays that are missing or damaged.
        """
        attributes = self.clip_attributes(name)
        where = f"{self.path}: clip {name}"
        try:
            group = zarr.open_group(self.path / name, mode="r", zarr_format=3)
            stored = {key: _read_array(group[key]) for key in ARRAYS if (self.path / name / key).is_dir()}
        except (ValueError, OSError, KeyError, TypeError, RuntimeError) as error:
            raise InputError(f"{where} cannot be read, the store is damaged ({error})") from error
        missing = [key for key in (*STATIC, "body_vertices") if key not in stored]
        if missing:
            raise InputError(f"{where} lacks {', '.join(missing)}; write it again")
        return Clip(
            **{key: stored.get(key) for key in ARRAYS},  # type: ignore[arg-type]
            fps=float(attributes["fps"]),
            info=dict(attributes["info"]),
            name=name,
        )

    def write(self, name: str, clip: Clip, *, split: str) -> None:
        """Write one clip whole or not at all, in place of one of the same name.

        Raises:
            InputError: a name that is not "<garment>/<clip>", or no split.
        """
        check_name(name, split)
        zarr.open_group(self.path, mode="r+", zarr_format=3).require_group(name.partition("/")[0])
        attributes = {
            "name": name,
            "split": split,
            "fps": float(clip.fps),
            "frames": clip.n_frames,
            "source": clip.info.get("source", self.attributes.get("source", "")),
            "licence": clip.info.get("licence", self.attributes.get("licence", "")),
            "info": dict(clip.info),
        }
        with written_whole_folder(self.path / name) as temporary:
            group = zarr.create_group(temporary, zarr_format=3, attributes=attributes)
            for key in ARRAYS:
                if getattr(clip, key) is not None:
                    _write_array(group, key, np.asarray(getattr(clip, key)))


def check_name(name: str, split: str) -> None:
    """Raise InputError unless a clip can be stored under this name and in this split."""
    if not re.fullmatch(r"[\w-][\w.-]*/[\w-][\w.-]*", name):
        raise InputError(f"clip name {name!r}: wanted <garment>/<clip> of letters, digits, '_', '-' and '.'")
    if not split:
        raise InputError(f"clip {name}: it needs a split, such as train or test")


def _attributes(path: Path) -> dict[str, Any]:
    """Attributes of the group at `path`, read as plain JSON so that a damaged file gives one clear line."""
    try:
        return dict(json.loads((path / "zarr.json").read_text())["attributes"])
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise InputError(f"{path / 'zarr.json'}: not the metadata of a Zarr v3 group ({error})") from error


def _write_array(group: zarr.Group, key: str, values: np.ndarray) -> None:
    attributes: dict[str, Any] = {}
    if key in PER_FRAME and grid.lies_on_grid(values):
        values, attributes = grid.to_differences(values), {"encoding": grid.ENCODING, "step": grid.STEP}
    shape = values.shape
    group.create_array(
        key,
        shape=shape,
        dtype=values.dtype,
        chunks=(min(FRAMES_PER_CHUNK, shape[0]), *shape[1:]) if key in PER_FRAME else shape,
        compressors=BloscCodec(cname="zstd", clevel=9, shuffle="bitshuffle" if attributes else "shuffle"),
        attributes=attributes,
    )[...] = values


def _read_array(array: Any) -> np.ndarray:
    values = np.asarray(array[...])
    encoding = array.attrs.get("encoding")
    if encoding is None:
        return values
    if encoding != grid.ENCODING:
        raise ValueError(f"unknown encoding {encoding!r}")
    return grid.from_differences(values, float(array.attrs["step"]))
