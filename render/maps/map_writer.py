"""Map files written, whole or some frames at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from render.errors import InputError
from render.files.npz_writer import NpzWriter
from render.maps.exr import written_folder
from render.maps.map_file import BY_FRAME, FORMAT, FORMAT_VERSION, MapFile


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
                out.write("format_version", FORMAT_VERSION)
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
