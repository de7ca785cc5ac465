"""A moving clip as an Alembic archive (Ogawa), through alembic3d: positions as samples, in metres, y up.

Facts of the format: the library's own source (github.com/alembic/alembic, AbcGeom: OPolyMesh, OFaceSet); polygons are
wound clockwise, seen from outside, as the exporters of Maya and Blender have it. Samples of the binding point to arrays
that they do not keep alive, and schemas to objects: both stay in variables until they were written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import imath
import numpy as np
from alembic3d import Abc, AbcCoreAbstract, AbcGeom

from imgtransfer.data.clip import Clip
from imgtransfer.exports.materials import parts_of
from imgtransfer.exports.objects import MovingObject, objects_of
from imgtransfer.exports.room import check_room
from render.files.atomic import written_whole


@contextmanager
def written_alembic(path: Path, *, step: int = 1) -> Iterator[Callable[[Clip], None]]:
    """Yield what takes the frames of a clip, some at a time; see `written_animation`.

    Each object is a polygon mesh below the top, with a sample a frame, texture coordinates by corner, and a face set a
    material; the form knows no colours and no images.

    Args:
        path: ends in .abc. step: what the numbers of the frames in the clip count by.
    """
    with written_whole(path) as temporary:
        archive = _Archive(temporary, step)
        yield archive.add
        archive.close()


class _Archive:
    """An archive that grows frame by frame.

    Where the disk is full the library ends the process, even when it only closes its file: it is opened, and given
    frames, when there is room for them and for the end, which grows with the frames.
    """

    def __init__(self, file: Path, step: int) -> None:
        self.file, self.step, self.done = file, step, 0
        self.archive: Any = None
        self.meshes: dict[str, Any] = {}

    def add(self, part: Clip) -> None:
        """Add the next frames.

        Raises:
            OSError: there is no room for them.
        """
        self.done += part.n_frames
        objects = objects_of(part)
        sizes = [12 * part.n_frames * len(thing.surface.vertices) for thing in objects]
        if self.archive is None:  # the first part has polygons and texture coordinates, too
            sizes += [64 * len(thing.surface.faces) for thing in objects]
        check_room(self.file, sum(sizes) + 1024 * self.done)
        if self.archive is None:
            self.archive = Abc.OArchive(str(self.file))
        for thing in objects:
            frames = thing.of_file(part)
            if thing.name not in self.meshes:
                self.meshes[thing.name] = AbcGeom.OPolyMesh(self.archive.getTop(), thing.name)
                _begin(self.meshes[thing.name].getSchema(), thing, frames[0], self.step / part.fps)
                frames = frames[1:]
            for frame in frames:
                sample, positions = AbcGeom.OPolyMeshSchemaSample(), _vectors(frame)
                sample.setPositions(positions)
                self.meshes[thing.name].getSchema().set(sample)

    def close(self) -> None:
        """Complete the file, which is so when its objects are gone."""
        self.meshes.clear()
        del self.archive


def _begin(schema: Any, thing: MovingObject, frame: np.ndarray, seconds: float) -> None:
    """The first sample, which has the polygons and texture coordinates of all; one comes every so many seconds."""
    schema.setTimeSampling(AbcCoreAbstract.TimeSampling(seconds, 0.0))
    surface = thing.surface
    clockwise = surface.faces[:, ::-1]
    arguments = [_vectors(frame), _ints(clockwise), _ints(np.full(len(clockwise), 3))]
    if surface.uvs is not None and surface.uv_faces is not None:
        uvs = np.concatenate([surface.uvs, np.zeros((1, 2))]).astype(np.float32)  # for corners that have none
        corners = np.where(surface.uv_faces < 0, len(surface.uvs), surface.uv_faces)[:, ::-1]
        indices = imath.UnsignedIntArray(corners.size)
        for place, index in enumerate(corners.ravel().tolist()):
            indices[place] = index
        values, scope = imath.V2fArrayFromBuffer(uvs), AbcGeom.GeometryScope.kFacevaryingScope
        arguments.append(AbcGeom.OV2fGeomParamSample(values, indices, scope))
    schema.set(AbcGeom.OPolyMeshSchemaSample(*arguments))
    used: set[str] = set()
    for material, faces in parts_of(thing.name, surface):
        face_set, numbers = schema.createFaceSet(_free_name(material.name, used)), _ints(faces)
        face_set.getSchema().set(AbcGeom.OFaceSetSchemaSample(numbers))


def _free_name(name: str, used: set[str]) -> str:
    """A name that Alembic takes, and none of `used`, which it is added to: a slash would begin an object within one."""
    first = free = name.replace("/", "_") or "material"
    number = 1
    while free in used:
        number += 1
        free = f"{first}_{number}"
    used.add(free)
    return free


def _vectors(values: np.ndarray) -> Any:
    return imath.V3fArrayFromBuffer(np.ascontiguousarray(values, np.float32))


def _ints(values: np.ndarray) -> Any:
    flat = np.ascontiguousarray(values, np.int32).ravel()  # of two axes the binding takes room for one
    return imath.IntArrayFromBuffer(flat)
