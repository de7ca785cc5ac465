"""Map files read and written, whole or some frames at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from render.errors import InputError
from render.files.npz import open_npz
from render.files.npz_writer import NpzWriter
from render.maps.exr import ExrFolder, written_folder
from render.maps.map_file import BY_FRAME, FORMAT, FORMAT_VERSION, OPTIONAL, READABLE_VERSIONS, MapFile


class _Source(Protocol):
    """Arrays on disk, named as in an npz."""

    @property
    def constant(self) -> dict[str, np.ndarray]:
        """Those that do not change from frame to frame."""
        ...

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of those of `BY_FRAME` that there are."""
        ...

    def rows(self, count: int) -> Iterator[dict[str, np.ndarray]]:
        """These, `count` frames at a time."""
        ...


class MapReader:
    """A map file of which only the frames that are asked for are in memory; make one with `open_maps`.

    Args:
        path: of the file. source: what it holds.

    Raises:
        InputError: another format or version, or an array that is missing or of a wrong shape.
    """

    def __init__(self, path: Path, source: _Source) -> None:
        self._path, self._source = path, source
        self._constant = _checked(path, source)
        shapes = source.shapes
        #: T.
        self.n_frames = shapes["rotation"][0] if shapes["rotation"] else 0
        if not self.n_frames:
            raise InputError(f"{path}: maps: no frames; rotation has shape {shapes['rotation']}")
        image = (len(self._constant["views"]), *self._constant["mask"].shape[1:])
        of_a_frame = {"position": (*image, 3), "normal": (*image, 3), "confidence": image}
        of_a_frame |= {"rotation": (3, 3), "translation": (3,)}
        for name, shape in shapes.items():
            wanted = (self.n_frames, *of_a_frame[name])
            if shape != wanted:
                raise InputError(f"{path}: maps: {name} must be of shape {wanted}; found {shape}")

    def parts(self, count: int) -> Iterator[MapFile]:
        """All frames in order, `count` at a time; the last part may be shorter.

        Raises:
            InputError: damaged content, or values that `MapFile` refuses.
        """
        missing: dict[str, Any] = dict.fromkeys(OPTIONAL)
        first = 0
        for arrays in self._source.rows(count):
            try:
                yield MapFile(**(missing | self._constant | arrays))
            except InputError as error:
                last = first + len(arrays["rotation"]) - 1
                where = f"frames {first} to {last}: " if (first, last) != (0, self.n_frames - 1) else ""
                raise InputError(f"{self._path}: {where}{error}") from error
            first += len(arrays["rotation"])


def open_maps(path: Path | str) -> MapReader:
    """Open what `save_maps` wrote, or another program as docs/maps.md says.

    Args:
        path: an npz, or a folder of EXR images.

    Raises:
        InputError: no such file, a damaged one, another format or version, an array missing or of a wrong
            shape.
    """
    path = Path(path)
    return MapReader(path, ExrFolder(path) if path.is_dir() else _NpzMaps(path))


def load_maps(path: Path | str) -> MapFile:
    """Read a map file whole.

    Raises:
        InputError: as `open_maps`, and values that are not finite or do not fit.
    """
    reader = open_maps(path)
    return next(reader.parts(reader.n_frames))


class _NpzMaps:
    """A map file as npz."""

    def __init__(self, path: Path) -> None:
        self._path = path
        known = {field.name for field in fields(MapFile)} | {"format", "format_version"}
        with open_npz(path, "an npz of maps, or a folder of EXR images,") as npz:
            present = [name for name in npz.names if name in known]
            self.constant = {name: npz.read(name) for name in present if name not in BY_FRAME}
            self.shapes = {name: npz.shape(name) for name in present if name in BY_FRAME}

    def rows(self, count: int) -> Iterator[dict[str, np.ndarray]]:
        with open_npz(self._path) as npz:
            columns = [npz.rows(name, count) for name in self.shapes]
            for parts in zip(*columns, strict=True):
                yield dict(zip(self.shapes, parts, strict=True))


def _checked(path: Path, source: _Source) -> dict[str, Any]:
    """What `MapFile` wants of the constant arrays."""
    arrays = dict(source.constant)
    file_format, version = arrays.pop("format", "none"), arrays.pop("format_version", "none")
    if str(file_format) != FORMAT or str(version) not in READABLE_VERSIONS:
        *earlier, latest = READABLE_VERSIONS
        raise InputError(
            f"{path}: format '{FORMAT}' version {', '.join(earlier)} or {latest} expected, "
            f"found '{file_format}' version {version}"
        )
    absent = {field.name for field in fields(MapFile)} - OPTIONAL - set(arrays) - set(source.shapes)
    if absent:
        raise InputError(f"{path}: {', '.join(sorted(absent))} missing from the map file")
    views = arrays["views"]
    if views.ndim != 1:
        raise InputError(f"{path}: views must be names (S,); found {views.shape}")
    numbers = {name: arrays[name] for name in ("fps", "contact_offset_m") if name in arrays}
    for name, value in numbers.items():
        if value.size != 1 or value.dtype.kind not in "fiu":
            raise InputError(f"{path}: {name} must be one number; found {value.dtype} {value.shape}")
    return arrays | {"views": tuple(views.tolist())} | {name: its.item() for name, its in numbers.items()}


@contextmanager
def written_maps(path: Path | str) -> Iterator[Callable[[MapFile], None]]:
    """Yield what takes the frames of a map file, some at a time; it appears whole when the block ends without an error.

        with written_maps("maps.npz") as add:
            for part in parts:
                add(part)

    Args:
        path: a name that ends in .npz: a compressed npz of plain arrays, named as the fields of `MapFile`; or a
            name without an ending: a folder of OpenEXR files (see `render.maps.exr`).

    Raises:
        InputError: the path ends otherwise, or is a folder that holds something else.
    """
    path = Path(path)
    if path.suffix == "":
        with written_folder(path, file_format=FORMAT, version=FORMAT_VERSION) as add:
            yield add
        return
    if path.suffix != ".npz":
        raise InputError(
            f"{path}: map files end in .npz; a name without an ending makes a folder of EXR files"
        )
    with NpzWriter(path) as out:
        started = False

        def add(maps: MapFile) -> None:
            nonlocal started
            values = {field.name: getattr(maps, field.name) for field in fields(maps)}
            if not started:
                out.write("format", FORMAT)
                out.write("format_version", maps.format_version)
            for name, value in values.items():
                if value is not None and name in BY_FRAME:
                    out.append(name, value)
                elif value is not None and not started:
                    out.write(name, value)
            started = True

        yield add


def save_maps(path: Path | str, maps: MapFile) -> None:
    """Write maps; whole or not at all. Arguments and errors as for `written_maps`."""
    with written_maps(path) as add:
        add(maps)
