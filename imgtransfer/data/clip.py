"""One clip: a garment template, a body and how both move. The exchange format for anyone's data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from imgtransfer.data.clip_checks import INDICES, check_arrays, plain
from imgtransfer.data.texture_files import store_textures
from render import InputError, Mesh
from render.files.atomic import written_whole
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
SKINNING = ("poses", "trans", "joints_rest", "parents", "blend_weights", "joint_transforms")
SURFACE = ("original_faces", "original_vertices", "uvs", "uv_faces", "face_materials")
STORED = (*REQUIRED[:-1], *SKINNING, *SURFACE)  # every array of a clip
PER_FRAME = ("garment_vertices", "body_vertices", "poses", "trans", "joint_transforms")
FLOATS = tuple(name for name in STORED if name not in INDICES)
_LONGEST_TEXT = 1 << 24  # bytes; a material library is the longest that anyone has
_LIMITS = {"poses": (ANGLES, "rad"), "blend_weights": (10.0, ""), "uvs": (FARTHEST, "")}  # no positions


@dataclass(frozen=True, eq=False)
class Clip:
    """Arrays of one clip, in world coordinates: metres, y up, the body faces +z in its rest pose.

    Args:
        template_vertices: (N, 3) float32, the garment in the body's rest pose.
        garment_faces: (F, 3) int, counter-clockwise from outside.
        garment_vertices: (T, N, 3) float32; None where only the body is known (something to predict for).
        body_rest: (B, 3) float32, the body in its rest pose, in the template's frame.
        body_faces: (G, 3) int.
        body_vertices: (T, B, 3) float32.
        fps: frames a second.
        poses: (T, J, 3) axis-angle of the SMPL joints, local; joint 0 is the global orientation.
        trans: (T, 3); the root joint is at `joints_rest[0] + trans` (the SMPL convention).
        joints_rest: (J', 3) rest positions; J' may be 1 where only the root is known.
        parents: (J',) int, parent of each joint, -1 for the root.
        blend_weights: (B, K) linear blend skinning weights of the body's vertices.
        joint_transforms: (T, K, 3, 4) rest-to-posed transforms that belong to `blend_weights`; where it is
            None, K = J and they follow from poses, trans, joints_rest and parents.
        original_faces: (F', 3) int, the garment's triangles as its file had them; this and the four that follow are
            a `render.Surface` (see `Clip.surface`), None where nothing of it is known.
        original_vertices: (M,) int, for each vertex of the file the template's vertex.
        uvs: (U, 2) float32 texture coordinates.
        uv_faces: (F', 3) int, indices into `uvs` of the corners of `original_faces`, -1 for none.
        face_materials: (F',) int, indices into the lines of `info["materials"]`; `info["mtl"]` describes them.
        info: free text such as source, licence and units, by name.
        name: what messages and tables call it.
    """

    template_vertices: np.ndarray
    garment_faces: np.ndarray
    garment_vertices: np.ndarray | None
    body_rest: np.ndarray
    body_faces: np.ndarray
    body_vertices: np.ndarray
    fps: float
    poses: np.ndarray | None = None
    trans: np.ndarray | None = None
    joints_rest: np.ndarray | None = None
    parents: np.ndarray | None = None
    blend_weights: np.ndarray | None = None
    joint_transforms: np.ndarray | None = None
    original_faces: np.ndarray | None = None
    original_vertices: np.ndarray | None = None
    uvs: np.ndarray | None = None
    uv_faces: np.ndarray | None = None
    face_materials: np.ndarray | None = None
    info: dict[str, str] = field(default_factory=dict)
    name: str = "clip"

    def __post_init__(self) -> None:
        arrays = {key: np.asarray(getattr(self, key)) for key in STORED if getattr(self, key) is not None}
        check_arrays({key: (values.shape, values.dtype) for key, values in arrays.items()}, self.name)
        check_faces(arrays["garment_faces"], len(self.template_vertices), f"{self.name}: garment_faces")
        check_faces(arrays["body_faces"], len(self.body_rest), f"{self.name}: body_faces")
        for key in FLOATS:
            if key in arrays:
                limit, unit = _LIMITS.get(key, (FARTHEST, "m"))
                check_finite(arrays[key], f"{self.name}: {key}", limit=limit, unit=unit)
        for key, values in arrays.items():
            object.__setattr__(self, key, plain(values, whole=key in INDICES))
        if self.parents is not None and (self.parents < -1).any():
            raise InputError(f"{self.name}: parents must be indices of joints, -1 for the root")
        if (self.original_faces is None) != (self.original_vertices is None):
            raise InputError(f"{self.name}: original_faces and original_vertices come together")
        surface = self.surface
        if surface is not None:
            used = surface.vertices
            if len(used) and not 0 <= used.min() <= used.max() < len(self.template_vertices):
                raise InputError(f"{self.name}: original_vertices must be indices of the template's vertices")
        if self.joint_transforms is not None:
            bad = np.argwhere(~(np.linalg.det(self.joint_transforms[..., :3].astype(np.float64)) > 0))
            if len(bad):
                raise InputError(
                    f"{self.name}: joint_transforms: that of frame {bad[0][0]}, joint {bad[0][1]} mirrors or flattens "
                    "the body; a rotation is wanted in its first three columns"
                )
        check_rate(self.fps, self.name)

    @property
    def n_frames(self) -> int:
        return len(self.body_vertices)

    @property
    def surface(self) -> Surface | None:
        """Texture coordinates, materials and the numbering of the garment's file; None where nothing is known.

        Raises:
            InputError: arrays that do not fit each other.
        """
        if self.original_faces is None or self.original_vertices is None:
            return None
        try:
            return Surface(
                np.asarray(self.original_faces, np.int64),
                np.asarray(self.original_vertices, np.int64),
                uvs=self.uvs,
                uv_faces=self.uv_faces,
                face_materials=self.face_materials,
                materials=tuple(self.info.get("materials", "").splitlines()),
                mtl=self.info.get("mtl", ""),
            )
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from error

    def with_surface(self, surface: Surface | None) -> Clip:
        """The same clip with the look and numbering of the file that its template came from."""
        if surface is None:
            return self
        text = {"materials": "\n".join(surface.materials), "mtl": surface.mtl}
        return replace(
            self,
            original_faces=surface.faces,
            original_vertices=surface.vertices,
            uvs=surface.uvs,
            uv_faces=surface.uv_faces,
            face_materials=surface.face_materials,
            info=self.info | {key: value for key, value in text.items() if value},
        )

    @property
    def template(self) -> Mesh:
        """The garment in the body's rest pose, with its surface."""
        return Mesh(self.template_vertices, self.garment_faces, source=self.name, surface=self.surface)

    def slice(self, frames: slice) -> Clip:
        """The same clip with only the frames of `frames`."""
        cut = {key: getattr(self, key)[frames] for key in PER_FRAME if getattr(self, key) is not None}
        return replace(self, **cut)

    def with_garment(self, vertices: np.ndarray) -> Clip:
        """The same clip with other garment vertices, (T, N, 3): a prediction in place of the truth."""
        return replace(self, garment_vertices=np.asarray(vertices, np.float32))


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
    constant = {key: npz.read(key) if key in present else None for key in STORED if key not in PER_FRAME}
    moving = [key for key in PER_FRAME if key in present]
    fps, info = float(npz.read("fps").reshape(())), with_found_textures(_texts(npz), path.parent)
    for rows in zip(*(npz.rows(key, count) for key in moving), strict=True):
        values = dict.fromkeys(PER_FRAME) | constant | dict(zip(moving, rows, strict=True))
        try:
            part = Clip(**values, fps=fps, info=info, name=path.stem)
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


def with_found_textures(info: Mapping[str, str], folder: Path | None) -> dict[str, str]:
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
            arrays = {key: getattr(clip, key) for key in STORED if getattr(clip, key) is not None}
            for key, values in arrays.items():
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
    """What is written of a clip's `info` to a file in a folder, after its textures have been copied to there."""

    def write(place: str, content: bytes) -> None:
        with written_whole(folder / place) as temporary:
            temporary.write_bytes(content)

    return {key: store_textures(text, write) if key == "mtl" else text for key, text in clip.info.items()}
