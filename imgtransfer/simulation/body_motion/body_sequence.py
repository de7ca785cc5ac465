"""A body mesh in motion, from the user's files: no skeleton, only where its vertices are in every frame."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.axes import InMetres
from imgtransfer.importers.formats.meshes import FPS
from imgtransfer.importers.mesh_files import find_body
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.running.fingerprint import files_fingerprint
from imgtransfer.simulation.motion_config import SequenceFiles
from render import InputError, Mesh, MeshSequence, Option
from render.files.scenes.reader import is_scene
from render.files.sequence import sequence_files
from render.mesh.measures import edge_lengths

_SCALE = 1.5  # by which a body's edges may be longer or shorter than in its rest pose, in the middle
_TORN = 1.5, 0.2  # by what factor edges change less, apart from a common one, and in what part of them more


@dataclass(frozen=True)
class BodySequence:
    """A body mesh sequence on disk. Make one with `find_sequence`; it is small, and read where it is simulated.

    Args:
        name: what clips are called after it.
        moving, rest: folder, pattern or point cache of the frames, and the mesh in the rest pose (None: the first
            frame).
        settings: how the files lie.
        fps: frames a second that it is resampled to, by time.
        content: a fingerprint of its files.
        frames: keep only so many.
    """

    name: str
    moving: Path
    rest: Path | None
    settings: SequenceFiles
    fps: float
    content: str
    frames: int | None = None

    def open(self) -> InMetres:
        """The body at rest and the first frame, and how they lay.

        Raises:
            InputError: files that cannot be read, or a rest pose that is not the frames' mesh.
        """
        settings, which = self.settings, Option("body_object", self.settings.body_object)
        return open_in_metres(
            self.moving, "body", settings.axes, self.rest, motion=settings.motion_axes, which=which
        )

    def count(self) -> int:
        """How many frames `read` will give.

        Raises:
            InputError: as `open`.
        """
        opened = self.open().sequence
        frames = resampled_frames(opened.n_frames, float(self.settings.fps or opened.fps or FPS), self.fps)
        return frames if self.frames is None else min(frames, self.frames)

    def read(self) -> SampledBody:
        """All frames, resampled and checked; the last one that was read is kept.

        Raises:
            InputError: files that cannot be read or do not fit together; the message names them.
        """
        return _read(self)


@dataclass(frozen=True, eq=False)
class SampledBody:
    """A body mesh in motion, at the frame rate that it is simulated at.

    Args:
        sequence: its frames in memory, and the body at rest; metres, y up, facing +z.
        rest_content: a fingerprint of the body at rest.
        fastest: the vertex, what the frame of the files is called into which, and the speed in m/s, of the fastest
            movement.
    """

    sequence: MeshSequence
    rest_content: str
    fastest: tuple[int, str, float]


def find_sequence(folder: Path, settings: SequenceFiles, fps: float) -> BodySequence:
    """The body in a clip's folder or scene file, with what is beside it (garment frames, a template) left alone.

    Raises:
        InputError: no body in the folder, or frames that are missing or of several kinds.
    """
    folder = folder.resolve()
    moving, rest = find_body(folder, settings.body_rest)
    files = sequence_files(moving)
    files = files if rest is None else [*files, rest]
    content = files_fingerprint(files)
    if any(is_scene(file) for file in files):
        # Such files say how they lie, so that it matters whether `unit: m` was given or is the default.
        content += f" {sorted(settings.axes.given)}"
    name = valid_clip_name("", folder.stem if is_scene(folder) else folder.name).partition("/")[2]
    return BodySequence(name, moving, rest, settings, fps, content)


@lru_cache(maxsize=1)
def _read(sequence: BodySequence) -> SampledBody:
    settings = sequence.settings
    opened = sequence.open().sequence
    body = weld_sequence(opened) if settings.weld else opened
    vertices, fps, rest = body.vertices(), float(settings.fps or body.fps or FPS), body.mesh
    if len(vertices) < 2:
        raise InputError(f"{sequence.moving}: a body mesh sequence needs two frames or more, found one")
    _check_like_rest(sequence, rest, vertices)
    moved = resampled(vertices, fps, sequence.fps)[: sequence.frames]
    if len(moved) < 2:
        raise InputError(
            f"{sequence.moving}: {len(vertices)} frames at {fps:g} a second are too short for two at {sequence.fps:g}"
        )
    content = hashlib.sha256(rest.vertices.tobytes() + rest.faces.tobytes()).hexdigest()
    vertex, frame, speed = _fastest(vertices, fps)
    sampled = MeshSequence.of_array(rest, moved, source=str(sequence.moving), fps=sequence.fps)
    return SampledBody(sampled, content, (vertex, body.frame_name(frame + 1), speed))


def _fastest(vertices: np.ndarray, fps: float) -> tuple[int, int, float]:
    """The vertex, the frame after which, and the speed in m/s, of the fastest movement."""
    displacements = [np.linalg.norm(end - start, axis=1) for start, end in pairwise(vertices)]
    frame = int(np.argmax([way.max() for way in displacements]))
    vertex = int(displacements[frame].argmax())
    return vertex, frame, float(displacements[frame][vertex] * fps)


def resampled_frames(count: int, given: float, fps: float) -> int:
    """How many frames `count` of them at `given` a second become at `fps`."""
    # Half a millionth of a frame of tolerance keeps a last frame that only rounding would drop.
    return count if given == fps else int((count - 1) / given * fps + 1e-6) + 1


def resampled(vertices: np.ndarray, given: float, fps: float) -> np.ndarray:
    """(T, B, 3) at `given` frames a second -> at `fps`: by time, on straight lines; the first frame stays."""
    if given == fps:
        return vertices
    last = len(vertices) - 1
    times = np.minimum(np.arange(resampled_frames(len(vertices), given, fps)) * (given / fps), last)
    before = np.minimum(times.astype(np.int64), last - 1)
    fraction = (times - before).astype(vertices.dtype)[:, None, None]
    return (1 - fraction) * vertices[before] + fraction * vertices[before + 1]


def speed_fault(sequence: BodySequence, body: SampledBody) -> str | None:
    """What is said of a body that jumps; None where its fastest vertex keeps within `settings.speed`."""
    vertex, name, speed = body.fastest
    if speed <= sequence.settings.speed:
        return None
    return (
        f"vertex {vertex} moves at {speed:.0f} m/s into {name}, at most {sequence.settings.speed:g} are allowed: is "
        f"the frame rate right ({Option('fps')}), and the vertex order the same in every frame?"
    )


def _check_like_rest(sequence: BodySequence, rest: Mesh, vertices: np.ndarray) -> None:
    """Compare edges with those at rest, in the first, middle and last frame.

    Raises:
        InputError: other units, or the vertices of another mesh.
    """
    lengths = edge_lengths(rest.vertices, rest.edges)
    for frame in sorted({0, len(vertices) // 2, len(vertices) - 1}):
        moved = edge_lengths(vertices[frame], rest.edges)
        ratio = moved[lengths > 0] / lengths[lengths > 0]
        middle = float(np.median(ratio))
        apart = np.abs(np.log(np.maximum(ratio, 1e-9) / max(middle, 1e-9))) > np.log(_TORN[0])
        if apart.mean() > _TORN[1]:
            raise InputError(
                f"{sequence.moving}: in frame {frame} the triangles are torn apart; the frames' vertices are not in "
                f"the order of {rest.source}"
            )
        if not 1 / _SCALE <= middle <= _SCALE:
            raise InputError(
                f"{sequence.moving}: in frame {frame} the body is {middle:.3g} times as large as in {rest.source}; "
                "export both in the same units"
            )
