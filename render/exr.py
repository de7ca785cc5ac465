"""Map files as folders of OpenEXR images: a file a frame and image, the template and perhaps a rest shape as OBJ."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from render.errors import InputError, one_line
from render.files import check_regular, written_whole_folder
from render.limits import MAX_LENGTH
from render.memory import check_memory
from render.meshio import load_mesh

if TYPE_CHECKING:
    from render.mapfile import MapFile

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


def save_folder(folder: Path, maps: MapFile, *, file_format: str, version: int) -> None:
    """Write a folder with `template.obj` and one `FRAME.IMAGE.exr` for each frame and image.

    Channels are float32: position.X .Y .Z and normal.X .Y .Z as encoded, mask (0 or 1), depth (metres) and
    confidence, those that there are. Box, camera and canonical frame stand in every header. Maps with `rest_vertices`
    get these as `rest.obj`.

    Args:
        folder: made, or replaced if it holds such files.
        maps: what to write.
        file_format, version: as in the npz.

    Raises:
        InputError: the folder holds something else.
    """
    if folder.exists() and not _ours(folder):
        raise InputError(f"{folder}: exists already and is no folder of EXR maps; choose another name")
    constant = {"boxLo": maps.box_lo, "boxHi": maps.box_hi, "fps": repr(maps.fps)}
    constant |= {"format": file_format, "formatVersion": version}
    with written_whole_folder(folder) as temporary:
        _write_obj(temporary / TEMPLATE, maps.template_vertices, maps.template_faces)
        if maps.rest_vertices is not None:
            _write_obj(temporary / REST, maps.rest_vertices, maps.template_faces)
        for frame in range(len(maps.rotation)):
            for image, camera in enumerate(maps.cameras):
                header = constant | {
                    "frame": frame,
                    "image": image,
                    "view": camera.name,
                    "layer": camera.layer,
                    "viewMatrix": camera.view,
                    "projectionMatrix": camera.projection,
                    "rotation": maps.rotation[frame],
                    "translation": maps.translation[frame],
                }
                _write(temporary / f"{frame:05d}.{image}.exr", header, _channels(maps, frame, image))


def load_folder(folder: Path) -> dict[str, Any]:
    """What `save_folder` wrote, as arrays by the names of an npz.

    Raises:
        InputError: no EXR files, one that cannot be read or is missing, or headers or channels that differ.
    """
    paths = sorted(folder.glob("*.exr"))
    if not paths:
        raise InputError(f"{folder}: no .exr files in it; a folder of EXR maps is wanted")
    files = {}
    for path in paths:
        header, channels = _read(path, len(paths))
        files[_number(path, header, "frame"), _number(path, header, "image")] = path, header, channels
    frames, images = (1 + max(key[axis] for key in files) for axis in (0, 1))
    lost = next((key for key in np.ndindex(frames, images) if key not in files), None)
    if lost or len(files) != len(paths):
        what = f"frame {lost[0]}, image {lost[1]} is missing" if lost else "two files are of one image"
        raise InputError(f"{folder}: {what}, of {frames} frames with {images} images each")
    first = files[0, 0]
    for (frame, image), (path, header, _) in files.items():
        for keys, other in ((_OF_ALL, first), (_OF_IMAGE, files[0, image]), (_OF_FRAME, files[frame, 0])):
            for key in keys:
                if not np.array_equal(_attribute(path, header, key), _attribute(*other[:2], key)):
                    raise InputError(f"{path}: '{key}' in its header is not that of {other[0].name}")
    values = {name: _attribute(*first[:2], key) for key, name in _OF_ALL.items()}
    for key, name in _OF_IMAGE.items():
        values[name] = np.stack([_attribute(*files[0, image][:2], key) for image in range(images)])
    for key, name in _OF_FRAME.items():
        values[name] = np.stack([_attribute(*files[frame, 0][:2], key) for frame in range(frames)])
    with contextlib.suppress(ValueError):  # a text that is no number stays one, which `load_maps` refuses
        values["fps"] = np.asarray(float(values["fps"]))
    template = load_mesh(folder / TEMPLATE)
    values |= {"template_vertices": template.vertices, "template_faces": template.faces}
    if (folder / REST).exists():
        rest = load_mesh(folder / REST)
        if not np.array_equal(rest.faces, template.faces):
            raise InputError(
                f"{folder / REST}: its faces are not those of {TEMPLATE}; the same garment is wanted"
            )
        values["rest_vertices"] = rest.vertices
    return values | _images(
        {key: (path, channels) for key, (path, _, channels) in files.items()}, frames, images
    )


def _images(files: dict, frames: int, images: int) -> dict[str, np.ndarray]:
    """The channels of all files, stacked to (T, S, H, W, 3) or (T, S, H, W); mask and depth to (S, H, W)."""
    path, first = files[0, 0]
    for other, channels in files.values():
        if channels.keys() != first.keys() or {c.shape for c in channels.values()} != {first["mask"].shape}:
            raise InputError(f"{other}: its size or channels are not those of {path.name}")
    found = {}
    for name in ("position", "normal"):
        keys = [f"{name}.{axis}" for axis in _AXES]
        if all(key in first for key in keys):
            stacks = [
                [np.stack([files[t, s][1][k] for k in keys], -1) for s in range(images)]
                for t in range(frames)
            ]
            found[name] = np.array(stacks)
    if "confidence" in first:
        found["confidence"] = np.array(
            [[files[t, s][1]["confidence"] for s in range(images)] for t in range(frames)]
        )
    found["mask"] = np.stack([files[0, s][1]["mask"] > 0.5 for s in range(images)])
    if "depth" in first:
        found["depth"] = np.stack([files[0, s][1]["depth"] for s in range(images)])
    return found


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
        file.write(str(path))


def _read(path: Path, alike: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and channels of a file, one of so many `alike`."""
    import OpenEXR  # noqa: PLC0415

    check_regular(path, "an OpenEXR image")
    try:
        with _without_its_notes(), OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            low, high = file.header()["dataWindow"]
            height, width = (int(high[axis]) - int(low[axis]) + 1 for axis in (1, 0))
            count = len(file.header()["channels"])
        if not (1 <= height <= MAX_LENGTH and 1 <= width <= MAX_LENGTH and count <= _MOST_CHANNELS):
            raise InputError(
                f"{path}: {height} x {width} pixels of {count} channels; up to {MAX_LENGTH} a side and "
                f"{_MOST_CHANNELS} channels are read"
            )
        check_memory(4 * alike * height * width * count, f"{path}: {alike} images like it")
        with _without_its_notes(), OpenEXR.File(str(path), separate_channels=True) as file:
            header = dict(file.header())
            channels = {
                name: np.array(channel.pixels, np.float32) for name, channel in file.channels().items()
            }
    except InputError:
        raise
    except Exception as error:  # its readers raise RuntimeError, ValueError, TypeError
        raise InputError(f"{path}: not a readable OpenEXR file ({one_line(error)})") from error
    if "mask" not in channels:
        raise InputError(f"{path}: no channel 'mask'; it has {', '.join(sorted(channels))}")
    return header, channels


@contextlib.contextmanager
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
