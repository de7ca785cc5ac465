"""One clip: a garment template, a body and how both move. The exchange format for anyone's data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from imgtransfer.data.clip_checks import INDICES, check_arrays, plain
from imgtransfer.data.clip_parts import (
    PER_FRAME,
    STORED,
    Body,
    Garment,
    Skeleton,
    Template,
    flat_arrays,
    parts_of,
)
from imgtransfer.data.texture_files import store_textures, writer_into
from render import InputError, Mesh
from render.files.npz import Npz, open_npz
from render.files.npz_writer import NpzWriter
from render.files.textures import with_full_paths
from render.limits import ANGLES, FARTHEST, check_rate
from render.mesh.mesh import check_faces, check_finite
from render.mesh.surface import Surface

REQUIRED = (
    "template_vertices",
    "garment_faces",
    "garment_vertices",
    "body_rest",
    "body_faces",
    "body_vertices",
    "fps",
)
FLOATS = tuple(name for name in STORED if name not in INDICES)
_LONGEST_TEXT = 1 << 24  # bytes; a material library is the longest that anyone has
_LIMITS = {"poses": (ANGLES, "rad"), "blend_weights": (10.0, ""), "uvs": (FARTHEST, "")}  # no positions


@dataclass(frozen=True, eq=False)
class Clip:
    """One garment on one moving body, in world coordinates: metres, y up, the body faces +z in its rest pose.

    Args:
        template: the garment in the body's rest pose, N vertices.
        garment: the same in T frames; None where only the body is known (something to predict for).
        body: at rest and in T frames.
        fps: frames a second.
        skeleton: what moves the body, as far as it is known.
        info: free text such as source, licence and units, by name.
        name: what messages and tables call it.

    Raises:
        InputError: arrays that are no numbers, do not fit each other, or lie where nothing can; the message has the
            names of `imgtransfer.data.clip_parts.FLAT`, which files have, too.
    """

    template: Template
    garment: Garment | None
    body: Body
    fps: float
    skeleton: Skeleton = field(default_factory=Skeleton)
    info: dict[str, str] = field(default_factory=dict)
    name: str = "clip"

    def __post_init__(self) -> None:
        arrays = {key: np.asarray(values) for key, values in self.arrays().items()}
        check_arrays({key: (values.shape, values.dtype) for key, values in arrays.items()}, self.name)
        check_faces(arrays["garment_faces"], len(arrays["template_vertices"]), f"{self.name}: garment_faces")
        check_faces(arrays["body_faces"], len(arrays["body_rest"]), f"{self.name}: body_faces")
        for key in FLOATS:
            if key in arrays:
                limit, unit = _LIMITS.get(key, (FARTHEST, "m"))
                check_finite(arrays[key], f"{self.name}: {key}", limit=limit, unit=unit)
        arrays = {key: plain(values, whole=key in INDICES) for key, values in arrays.items()}
        for key, part in _parts(self.name, arrays, self.template.surface).items():
            object.__setattr__(self, key, part)
        self._check_values()

    def _check_values(self) -> None:
        if self.skeleton.parents is not None and (self.skeleton.parents < -1).any():
            raise InputError(f"{self.name}: parents must be indices of joints, -1 for the root")
        if self.template.surface is not None:
            used = self.template.surface.vertices
            if len(used) and not 0 <= used.min() <= used.max() < len(self.template.vertices):
                raise InputError(f"{self.name}: original_vertices must be indices of the template's vertices")
        if self.skeleton.joint_transforms is not None:
            turns = self.skeleton.joint_transforms[..., :3].astype(np.float64)
            bad = np.argwhere(~(np.linalg.det(turns) > 0))
            if len(bad):
                raise InputError(
                    f"{self.name}: joint_transforms: that of frame {bad[0][0]}, joint {bad[0][1]} mirrors or flattens "
                    "the body; a rotation is wanted in its first three columns"
                )
        check_rate(self.fps, self.name)

    @classmethod
    def of_arrays(
        cls, arrays: Mapping[str, np.ndarray], *, fps: float, info: Mapping[str, str], name: str
    ) -> Clip:
        """The clip of a file: the inverse of `arrays` and `texts`.

        Args:
            arrays: by the names of `imgtransfer.data.clip_parts.FLAT`. info: the file's texts.

        Raises:
            InputError: as the class.
        """
        check_arrays({key: (values.shape, values.dtype) for key, values in arrays.items()}, name)
        texts = dict(info)
        look = None
        if "original_faces" in arrays:
            names = texts.pop("materials", "")  # a line feed ends each; names may hold other line ends
            look = tuple(names.split("\n")) if names else (), texts.pop("mtl", "")
        return cls(**_parts(name, arrays, look), fps=fps, info=texts, name=name)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array that is there, by its name in files and messages."""
        return flat_arrays(self.template, self.garment, self.body, self.skeleton)

    def texts(self) -> dict[str, str]:
        """What a file says beside the arrays: `info`, and the materials of the template's surface."""
        surface = self.template.surface
        if surface is None:
            return dict(self.info)
        look = {"materials": "\n".join(surface.materials), "mtl": surface.mtl}
        return self.info | {key: text for key, text in look.items() if text}

    @property
    def n_frames(self) -> int:
        return len(self.body.vertices)

    def with_surface(self, surface: Surface | None) -> Clip:
        """The same clip with the look and numbering of the file that its template came from."""
        return self if surface is None else replace(self, template=replace(self.template, surface=surface))

    @property
    def template_mesh(self) -> Mesh:
        """The garment in the body's rest pose, with its surface, in float64 and called as the clip is."""
        template = self.template
        return Mesh(template.vertices, template.faces, source=self.name, surface=template.surface)

    def slice(self, frames: slice) -> Clip:
        """The same clip with only the frames of `frames`."""
        arrays = self.arrays()
        cut = {key: values[frames] if key in PER_FRAME else values for key, values in arrays.items()}
        return replace(self, **_parts(self.name, cut, self.template.surface))

    def with_garment(self, vertices: np.ndarray) -> Clip:
        """The same clip with other garment vertices, (T, N, 3): a prediction in place of the truth."""
        return replace(self, garment=Garment(np.asarray(vertices, np.float32)))


def _parts(
    name: str, arrays: Mapping[str, np.ndarray], look: Surface | tuple[tuple[str, ...], str] | None
) -> dict[str, Any]:
    """A clip's parts from its arrays; the surface's texts are those of `look`. Errors name the clip."""
    materials, mtl = (look.materials, look.mtl) if isinstance(look, Surface) else look or ((), "")
    try:
        return parts_of(arrays, materials=materials, mtl=mtl)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def load_clip(path: str | Path) -> Clip:
    """Read a clip npz (never unpickling).

    Raises:
        InputError: the file is missing, is no npz, lacks a required array, or holds arrays that do not fit.
    """
    path = Path(path)
    with open_npz(path, f"a clip npz (keys: {', '.join(REQUIRED)})") as npz:
        return clip_of(npz, path)


def clip_of(npz: Npz, path: Path) -> Clip:
    """The clip in an open npz file.

    Raises:
        InputError: as `load_clip`.
    """
    check_clip_npz(npz, path)
    return next(clip_parts(npz, path, npz.shape("body_vertices")[0]))


def clip_parts(npz: Npz, path: Path, count: int) -> Iterator[Clip]:
    """The clip in an open npz file, `count` frames at a time; the last part may be shorter.

    Raises:
        InputError: as `load_clip`.
    """
    present = check_clip_npz(npz, path)
    constant = {key: npz.read(key) for key in present if key not in PER_FRAME}
    moving = [key for key in PER_FRAME if key in present]
    fps, info = float(npz.read("fps").reshape(())), with_texture_paths(_texts(npz), path.parent)
    for rows in zip(*(npz.rows(key, count) for key in moving), strict=True):
        try:
            arrays = constant | dict(zip(moving, rows, strict=True))
            part = Clip.of_arrays(arrays, fps=fps, info=info, name=path.stem)
        except InputError as error:
            raise InputError(f"{path}: {str(error).removeprefix(f'{path.stem}: ')}") from error
        yield part


def check_clip_npz(npz: Npz, path: Path) -> list[str]:
    """The arrays of a clip that an open npz holds; their data are not read.

    Raises:
        InputError: a required array is lacking, or shapes and types that do not fit.
    """
    missing = [key for key in REQUIRED if key not in npz and key != "garment_vertices"]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; a clip npz holds {', '.join(REQUIRED)}")
    present = [key for key in STORED if key in npz]
    check_arrays({key: (npz.shape(key), npz.dtype(key)) for key in present}, str(path))
    shape, dtype = npz.shape("fps"), npz.dtype("fps")
    if any(length != 1 for length in shape) or dtype.kind not in "fiu":
        raise InputError(f"{path}: fps must be one number, found {dtype} of shape {shape}")
    return present


def with_texture_paths(info: Mapping[str, str], folder: Path | None) -> dict[str, str]:
    """A stored clip's `info`, in which only images under the folder that it was stored in have full paths."""
    return {key: with_full_paths(text, folder) if key == "mtl" else text for key, text in info.items()}


def _texts(npz: Npz) -> dict[str, str]:
    """The single texts of an npz, by name."""
    texts = [name for name in npz.names if name not in STORED and npz.shape(name) == ()]
    return {
        name: str(npz.read(name))
        for name in texts
        if npz.dtype(name).kind == "U" and npz.dtype(name).itemsize <= _LONGEST_TEXT
    }


@contextmanager
def written_clip(path: str | Path) -> Iterator[Callable[[Clip], None]]:
    """Yield what takes the frames of a clip, some at a time; the npz appears whole when the block ends without error.

    All parts have the same arrays; those that do not change with time, and the rest, are taken from the first. Its
    textures are copied into textures/ beside the file.
    """
    with NpzWriter(Path(path)) as out:
        started = False

        def add(clip: Clip) -> None:
            nonlocal started
            for key, values in clip.arrays().items():
                if key in PER_FRAME:
                    out.append(key, values)
                elif not started:
                    out.write(key, values)
            if not started:
                out.write("fps", np.float64(clip.fps))
                for key, text in stored_info(clip, Path(path).parent).items():
                    out.write(key, np.str_(text))
            started = True

        yield add


def save_clip(path: str | Path, clip: Clip) -> Path:
    """Write a clip npz; the file appears whole or not at all. Its textures are copied into textures/ beside."""
    with written_clip(path) as add:
        add(clip)
    return Path(path)


def stored_info(clip: Clip, folder: Path) -> dict[str, str]:
    """What is written of a clip's texts to a file in a folder, after its textures have been copied to there."""
    write = writer_into(folder)
    return {key: store_textures(text, write) if key == "mtl" else text for key, text in clip.texts().items()}
