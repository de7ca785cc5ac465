"""The data set: a Zarr v3 store, one group a garment and clip, lossless, written clip by clip."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imgtransfer.data.arrays import write_array
from imgtransfer.data.clip import Clip
from imgtransfer.data.location import place_at
from imgtransfer.data.metadata import ClipAttributes, Rejection, parsed, read_clips, read_root, validated
from imgtransfer.data.place import METADATA, Place, group_metadata
from imgtransfer.data.reader import StoredReader
from imgtransfer.data.schema import (
    ARRAYS,
    FORMAT,
    NEVER_ZERO,
    PER_FRAME,
    SCHEMA_VERSION,
    check_name,
    is_plain,
    versions,
)
from imgtransfer.data.texture_files import store_textures
from render import InputError
from render.mesh.mesh import zero_frame

REJECTED = "rejected"  # folder with a JSON file for each clip that was made and found wanting


@dataclass(frozen=True)
class DataSet:
    """A folder of clips, on disk or behind a URL. Make one with `create`, `open` or `open_or_create`.

    On disk: root attributes `format`, `schema_version`, `units`, `up`, `title`, `source`, `licence` and
    `versions`; groups `<garment>/<clip>` with the arrays of `Clip`, those that change with time chunked by
    32 frames, and attributes `name`, `split`, `fps`, `frames`, `units`, `up`, `source`, `licence`, `versions`,
    `schema_version`, `arrays` (their names) and `info`. Positions that lie on the 2⁻¹⁶ m grid of
    `imgtransfer.data.grid` are stored as differences in time; the reader returns the same float32.

    A clip is there once its group's metadata are, which are written last. Several processes may write different
    clips at once.

    Args:
        path: the folder or URL.
        attributes: the root attributes.
        place: where it lies.
    """

    path: Path | str
    attributes: dict[str, Any]
    place: Place

    @classmethod
    def create(cls, path: str | Path, *, title: str = "", licence: str = "", source: str = "") -> DataSet:
        """Make an empty data set.

        Raises:
            InputError: something stands at `path` already.
        """
        place = place_at(path)
        place.check_writable()
        if not place.empty():
            raise InputError(f"{path}: exists already; a data set is made in a new or empty folder")
        attributes = {
            "format": FORMAT,
            "schema_version": SCHEMA_VERSION,
            "units": "m",
            "up": "y",
            "title": title,
            "source": source,
            "licence": licence,
            "versions": versions(),
        }
        place.write(METADATA, group_metadata(attributes))
        return cls(path, attributes, place)

    @classmethod
    def open(cls, path: str | Path) -> DataSet:
        """Open a data set that exists.

        Raises:
            InputError: no data set at `path`, or one of a schema version that this program does not know.
        """
        place = place_at(path)
        if not place.exists(METADATA):
            raise InputError(
                f"{path}: no data set; wanted is a folder made by `imgtransfer simulate` or `import`, "
                "or the zip file that `imgtransfer export` makes of one"
            )
        attributes = read_root(place, str(path))
        place.put_back()
        return cls(path, attributes, place)

    @classmethod
    def open_or_create(
        cls, path: str | Path, *, title: str = "", licence: str = "", source: str = ""
    ) -> DataSet:
        """`create` where nothing stands at `path`, else `open`: to write to.

        Raises:
            InputError: a place that is only read, or something else than a data set at `path`.
        """
        place = place_at(path)
        place.check_writable()
        if not place.empty():
            return cls.open(path)
        try:
            return cls.create(path, title=title, licence=licence, source=source)
        except InputError:
            if place.exists(METADATA):  # another process has just made it
                return cls.open(path)
            raise

    def names(self, split: str | None = None) -> list[str]:
        """Names of the clips, "<garment>/<clip>", sorted; only those of `split` where one is given."""
        if split is None:
            return self._groups()
        return [name for name, its in self.splits().items() if its == split]

    def splits(self) -> dict[str, str]:
        """The split of every clip, by name, sorted."""
        names = self._groups()
        clips = read_clips(self.place, names, str(self.path))
        return {name: attributes.split for name, attributes in zip(names, clips, strict=True)}

    def clip_attributes(self, name: str) -> ClipAttributes:
        """Attributes of one clip, see the class.

        Raises:
            InputError: no such clip (the message lists those there are), or damaged metadata.
        """
        if not self.has(name):
            raise InputError(f"{self.path}: no clip {name!r}; it has {', '.join(self.names()) or 'none'}")
        return read_clips(self.place, [name], str(self.path))[0]

    def has(self, name: str) -> bool:
        """Whether there is such a clip."""
        return is_plain(name) and self.place.exists(f"{name}/{METADATA}")

    def split(self, name: str) -> str:
        """The split that the clip belongs to, such as "train" or "test"."""
        return self.clip_attributes(name).split

    def reader(self, name: str) -> StoredReader:
        """The clip, for reading some of its frames.

        Raises:
            InputError: no such clip.
        """
        return StoredReader(self.place, str(self.path), name, self.clip_attributes(name))

    def read(self, name: str) -> Clip:
        """Read one clip; its arrays equal those that were written, bit for bit.

        Raises:
            InputError: no such clip, or arrays that are missing or damaged.
        """
        return self.reader(name).clip()

    def write(self, name: str, clip: Clip, *, split: str) -> None:
        """Write one clip whole or not at all, in place of one of the same name.

        Raises:
            InputError: a name that is not "<garment>/<clip>", no split, or a data set of schema version 1.
        """
        check_name(name, split)
        if self.attributes["schema_version"] != SCHEMA_VERSION:
            raise InputError(
                f"{self.path}: data set of schema version {self.attributes['schema_version']}, which is read only; "
                f"imgtransfer migrate {self.path} makes it version {SCHEMA_VERSION}"
            )
        self._write(name, clip, split)

    def reject(self, name: str, reason: str, made: str) -> None:
        """Keep why a clip was made and not taken in, so that nobody makes it again in vain.

        Args:
            name: "<garment>/<clip>". reason: one line.
            made: what decided the outcome, as a text that changes when a new attempt is worth while.
        """
        entry = {"name": name, "reason": reason, "made": made}
        self.place.write(f"{REJECTED}/{_flat(name)}.json", (json.dumps(entry, indent=2) + "\n").encode())

    def rejected(self) -> dict[str, dict[str, str]]:
        """By name, the `reason` and `made` of the clips that were rejected and not written since."""
        rejections = {}
        files = self.place.files(REJECTED)
        contents = self.place.read_many([f"{REJECTED}/{file}" for file in files])
        for file, content in zip(files, contents, strict=True):
            if content is None:
                continue  # its clip has been written meanwhile
            where = f"{self.path}/{REJECTED}/{file}"
            entry = validated(Rejection, parsed(content, where), where)
            if not self.has(entry.name):
                rejections[entry.name] = {"reason": entry.reason, "made": entry.made}
        return rejections

    def _groups(self) -> list[str]:
        """Names of the clips. They are shown, and become names of files elsewhere."""
        names = self.place.groups(2)
        for name in names:
            if not is_plain(name):
                raise InputError(
                    f"{self.path}: a clip of the name {name!r}; rename its folder to letters, digits, '_', '-' and '.'"
                )
        return names

    def _keep(self, key: str, content: bytes) -> None:
        """Write a file whose name tells its content, unless it is there."""
        if not self.place.exists(key):
            self.place.write(key, content)

    def _write(self, name: str, clip: Clip, split: str) -> None:
        garment = f"{name.partition('/')[0]}/{METADATA}"
        if not self.place.exists(garment):  # for other readers of Zarr
            self.place.write(garment, group_metadata({}))
        own = clip.arrays()
        arrays = {key: own[key] for key in ARRAYS if key in own}
        for key in NEVER_ZERO:
            if key not in arrays:
                continue
            if (lost := zero_frame(arrays[key] if key in PER_FRAME else arrays[key][None])) is not None:
                raise InputError(
                    f"{name}: {key}: frame {lost} is all zeros, which is no mesh; nothing is written"
                )
        info = {
            key: store_textures(text, self._keep) if key == "mtl" else text
            for key, text in clip.texts().items()
        }
        attributes = {
            "name": name,
            "split": split,
            "fps": float(clip.fps),
            "frames": clip.n_frames,
            "units": "m",
            "up": "y",
            "source": clip.info.get("source", self.attributes.get("source", "")),
            "licence": clip.info.get("licence", self.attributes.get("licence", "")),
            "versions": versions(),
            "schema_version": SCHEMA_VERSION,
            "arrays": list(arrays),
            "info": info,
        }
        with self.place.whole_group(name, attributes) as group:
            for key, values in arrays.items():
                write_array(group.store(key), values, by_frame=key in PER_FRAME)
        self.place.remove(f"{REJECTED}/{_flat(name)}.json")


def _flat(name: str) -> str:
    return name.replace("/", "__")
