"""Map files as folders of OpenEXR images: a file a frame and image, the template and perhaps a rest shape as OBJ."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from render.errors import InputError, one_line
from render.files.atomic import check_regular, written_whole_folder
from render.files.mesh_files import load_mesh
from render.limits import MAX_LENGTH
from render.memory import check_memory

if TYPE_CHECKING:
    from render.maps.map_file import MapFile

TEMPLATE, REST = "template.obj", "rest.obj"
_AXES = "XYZ"
# What each file's header holds besides its frame's and image's number, and where it stands in a `MapFile`.
_OF_ALL = {
    "boxLo": "box_lo",
    "boxHi": "box_hi",
    "fps": "fps",
    "format": "format",
    "formatVersion": "format_version",
}
_OPTIONAL = {"contactOffset": "contact_offset_m"}  # as _OF_ALL, where it is known
_TEXTS = ("fps", "contact_offset_m")  # numbers as text, to the last bit
_OF_IMAGE = {
    "viewMatrix": "view_matrices",
    "projectionMatrix": "projection_matrices",
    "view": "views",
    "layer": "layers",
}
_OF_FRAME = {"rotation": "rotation", "translation": "translation"}
_SHAPES: dict[str, tuple[int, ...]] = {"viewMatrix": (4, 4), "projectionMatrix": (4, 4), "rotation": (3, 3)}
_SHAPES |= dict.fromkeys(("boxLo", "boxHi", "translation"), (3,))  # all others are single numbers or texts
_MOST_CHANNELS = 64


@contextmanager
def written_folder(folder: Path, *, file_format: str, version: int) -> Iterator[Callable[[MapFile], None]]:
    """Yield what takes the frames of a folder with `template.obj` and one `FRAME.IMAGE.exr` for each frame and image.

    Channels are float32: position.X .Y .Z and normal.X .Y .Z as encoded, mask (0 or 1), depth (metres) and
    confidence, those that there are. Box, camera, canonical frame and, where it is known, the contact offset stand in
    every header. Maps with `rest_vertices` get these as `rest.obj`.

    Args:
        folder: made, or replaced if it holds such files, when the block ends without an error.
        file_format, version: as in the npz.

    Raises:
        InputError: the folder holds something else.
    """
    if folder.exists() and not _ours(folder):
        raise InputError(f"{folder}: exists already and is no folder of EXR maps; choose another name")
    with written_whole_folder(folder) as temporary:
        written = 0

        def add(maps: MapFile) -> None:
            nonlocal written
            if maps.layout is not None:
                raise InputError(
                    f"{folder}: a folder of EXR images has no room for a layout, which maps of views: uv need; write "
                    "an npz"
                )
            if not written:
                _write_obj(temporary / TEMPLATE, maps.template_vertices, maps.template_faces)
                if maps.rest_vertices is not None:
                    _write_obj(temporary / REST, maps.rest_vertices, maps.template_faces)
            constant = {"boxLo": maps.box_lo, "boxHi": maps.box_hi, "fps": repr(maps.fps)}
            constant |= {"format": file_format, "formatVersion": version}
            if maps.contact_offset_m is not None:
                constant["contactOffset"] = repr(maps.contact_offset_m)
            for frame in range(maps.n_frames):
                for image, camera in enumerate(maps.cameras):
                    header = constant | {
                        "frame": written,
                        "image": image,
                        "view": camera.name,
                        "layer": camera.layer,
                        "viewMatrix": camera.view,
                        "projectionMatrix": camera.projection,
                        "rotation": maps.rotation[frame],
                        "translation": maps.translation[frame],
                    }
                    _write(temporary / f"{written:05d}.{image}.exr", header, _channels(maps, frame, image))
                written += 1

        yield add


class ExrFolder:
    """What `written_folder` wrote, as arrays by the names of an npz; images are read when they are asked for.

    Args:
        folder: of EXR files.

    Attributes:
        constant: arrays that do not change from frame to frame.
        shapes: of the others.

    Raises:
        InputError: no EXR files, one that cannot be read or is missing, or headers or channels that differ.
    """

    def __init__(self, folder: Path) -> None:
        paths = sorted(folder.glob("*.exr"))
        if not paths:
            raise InputError(f"{folder}: no .exr files in it; a folder of EXR maps is wanted")
        headers: dict[tuple[int, int], tuple[Path, dict[str, Any]]] = {}
        for path in paths:
            header = _header(path)
            headers[_number(path, header, "frame"), _number(path, header, "image")] = path, header
        self._paths = {key: path for key, (path, _) in headers.items()}
        self._frames, self._images = (1 + max(key[axis] for key in self._paths) for axis in (0, 1))
        whole = self._frames * self._images
        if not len(self._paths) == len(paths) == whole:
            # At most as many as there are files lie before the first that is missing.
            lost = next(
                (key for key in np.ndindex(self._frames, self._images) if key not in self._paths), None
            )
            what = f"frame {lost[0]}, image {lost[1]} is missing" if lost else "two files are of one image"
            raise InputError(f"{folder}: {what}, of {self._frames} frames with {self._images} images each")
        _check_agreement(headers)
        files = [(self._paths[0, image], *_read(self._paths[0, image])) for image in range(self._images)]
        path, header, self._like = files[0]
        for other, _, channels in files:
            self._alike(other, channels)
        self.constant = {name: _attribute(path, header, key) for key, name in _OF_ALL.items()}
        for key, name in _OPTIONAL.items():
            if key in header:
                self.constant[name] = _attribute(path, header, key)
        for key, name in _OF_IMAGE.items():
            self.constant[name] = np.stack([_attribute(*file[:2], key) for file in files])
        for name in self.constant.keys() & set(_TEXTS):
            with contextlib.suppress(ValueError):  # a text that is no number stays one, which readers refuse
                self.constant[name] = np.asarray(float(self.constant[name]))
        self.constant |= _meshes(folder)
        self.constant["mask"] = np.stack([channels["mask"] > 0.5 for _, _, channels in files])
        if "depth" in self._like:
            self.constant["depth"] = np.stack([channels["depth"] for _, _, channels in files])
        self.shapes = {name: (self._frames, *values.shape[1:]) for name, values in self._rows(0, 1).items()}

    def rows(self, count: int) -> Iterator[dict[str, np.ndarray]]:
        """Arrays with one value a frame, `count` frames at a time: (T, S, H, W, 3) and so on.

        Raises:
            InputError: a file that cannot be read, or has another size or other channels than the first.
        """
        return (
            self._rows(first, min(first + count, self._frames)) for first in range(0, self._frames, count)
        )

    def _rows(self, start: int, stop: int) -> dict[str, np.ndarray]:
        by_name: dict[str, list[Any]] = {}
        for frame in range(start, stop):
            files = [(path, *_read(path)) for path in (self._paths[frame, s] for s in range(self._images))]
            images = [self._alike(path, channels) for path, _, channels in files]
            for name in ("position", "normal"):
                keys = [f"{name}.{axis}" for axis in _AXES]
                if all(key in self._like for key in keys):
                    stacks = [np.stack([channels[key] for key in keys], -1) for channels in images]
                    by_name.setdefault(name, []).append(stacks)
            if "confidence" in self._like:
                by_name.setdefault("confidence", []).append([channels["confidence"] for channels in images])
            for key, name in _OF_FRAME.items():
                by_name.setdefault(name, []).append(_attribute(*files[0][:2], key))
        return {name: np.array(values) for name, values in by_name.items()}

    def _alike(self, path: Path, channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The channels; InputError unless they are those of the first file."""
        size = self._like["mask"].shape
        if channels.keys() != self._like.keys() or {c.shape for c in channels.values()} != {size}:
            raise InputError(f"{path}: its size or channels are not those of {self._paths[0, 0].name}")
        return channels


def _check_agreement(headers: dict[tuple[int, int], tuple[Path, dict[str, Any]]]) -> None:
    """Raise InputError where the files of one image, of one frame, or all of them, do not say the same of it."""
    first = headers[0, 0]
    of_all = (*_OF_ALL, *(key for key in _OPTIONAL if any(key in header for _, header in headers.values())))
    for (frame, image), (path, header) in headers.items():
        for keys, other in ((of_all, first), (_OF_IMAGE, headers[0, image]), (_OF_FRAME, headers[frame, 0])):
            for key in keys:
                if not np.array_equal(_attribute(path, header, key), _attribute(*other, key)):
                    raise InputError(f"{path}: '{key}' in its header is not that of {other[0].name}")


def _meshes(folder: Path) -> dict[str, np.ndarray]:
    """The template, and the rest shape if there is one."""
    template = load_mesh(folder / TEMPLATE)
    meshes = {"template_vertices": template.vertices, "template_faces": template.faces}
    if (folder / REST).exists():
        rest = load_mesh(folder / REST)
        if not np.array_equal(rest.faces, template.faces):
            raise InputError(
                f"{folder / REST}: its faces are not those of {TEMPLATE}; the same garment is wanted"
            )
        meshes["rest_vertices"] = rest.vertices
    return meshes


def _channels(maps: MapFile, frame: int, image: int) -> dict[str, np.ndarray]:
    channels = {"mask": maps.mask[image].astype(np.float32)}
    if maps.depth is not None:
        channels["depth"] = maps.depth[image]
    if maps.confidence is not None:
        channels["confidence"] = maps.confidence[frame, image]
    for name, kind in (("position", maps.position), ("normal", maps.normal)):
        if kind is not None:
            channels |= {f"{name}.{axis}": kind[frame, image, ..., k] for k, axis in enumerate(_AXES)}
    return channels


def _write(path: Path, header: dict[str, Any], channels: dict[str, np.ndarray]) -> None:
    import OpenEXR  # noqa: PLC0415

    header = header | {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # Copies: the library overwrites the arrays that it is given.
    copies = {name: np.array(channel, np.float32, order="C") for name, channel in channels.items()}
    with OpenEXR.File(header, copies) as file:
        try:
            file.write(str(path))
        except RuntimeError as error:  # a full disk, for instance; the text ends with the system's reason
            reason = str(error).rpartition('". ')[2].rstrip(".")
            raise OSError(errno.EIO, reason, str(path)) from error


def _header(path: Path) -> dict[str, Any]:
    """Of an image of a size that is read."""
    import OpenEXR  # noqa: PLC0415

    check_regular(path, "an OpenEXR image")
    with _faults_named(path), OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        header = dict(file.header())
        low, high = header["dataWindow"]
        height, width = (int(high[axis]) - int(low[axis]) + 1 for axis in (1, 0))
        count = len(header["channels"])
    if not (1 <= height <= MAX_LENGTH and 1 <= width <= MAX_LENGTH and count <= _MOST_CHANNELS):
        raise InputError(
            f"{path}: {height} x {width} pixels of {count} channels; up to {MAX_LENGTH} a side and "
            f"{_MOST_CHANNELS} channels are read"
        )
    check_memory(4 * height * width * count, f"{path}: the image")
    return header


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    import OpenEXR  # noqa: PLC0415

    _header(path)  # before there is room for what it says
    with _faults_named(path), OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: np.array(channel.pixels, np.float32) for name, channel in file.channels().items()}
    if "mask" not in channels:
        raise InputError(f"{path}: no channel 'mask'; it has {', '.join(sorted(channels))}")
    return header, channels


@contextmanager
def _without_its_notes() -> Iterator[None]:
    """Keep off the terminal what the library and the one beneath it print about files that they then refuse."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@contextmanager
def _faults_named(path: Path) -> Iterator[None]:
    try:
        with _without_its_notes():
            yield
    except Exception as error:  # its readers raise RuntimeError, ValueError, TypeError
        raise InputError(f"{path}: not a readable OpenEXR file ({one_line(error)})") from error


def _attribute(path: Path, header: dict[str, Any], key: str) -> np.ndarray:
    if key not in header:
        raise InputError(f"{path}: its header lacks '{key}'")
    try:
        value = np.asarray(header[key])
    except ValueError:  # parts of different lengths
        value = np.empty(0, object)
    if value.dtype == object or value.shape != _SHAPES.get(key, ()):
        raise InputError(
            f"{path}: '{key}' in its header must have shape {_SHAPES.get(key, ())}, found {str(header[key])[:80]!r}"
        )
    return value


def _number(path: Path, header: dict[str, Any], key: str) -> int:
    value = _attribute(path, header, key)
    if value.ndim != 0 or value.dtype.kind not in "iu" or not 0 <= value < 10**6:
        raise InputError(f"{path}: '{key}' in its header must be a whole number from 0 on, found {value}")
    return int(value)


def _ours(folder: Path) -> bool:
    return folder.is_dir() and all(
        path.suffix == ".exr" or path.name in (TEMPLATE, REST) for path in folder.iterdir()
    )


def _write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]  # repr: read back to the last bit
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
