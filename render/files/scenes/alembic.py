"""Alembic archives (.abc), through alembic3d; vertices in the file's units and axes, which it does not state.

Facts of the format: the library's own source (github.com/alembic/alembic, AbcGeom: IPolyMesh, ISubD, IXform, IFaceSet);
polygons are wound clockwise, seen from outside, as the exporters and importers of Maya and Blender have it (Blender:
`source/blender/io/alembic/intern/abc_reader_mesh.cc`, which turns every polygon round).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from alembic3d import Abc, AbcGeom

from render.errors import InputError
from render.files.scenes.objects import Look, SceneMesh, check_same, face_sets, in_world
from render.files.scenes.polygons import Polygons

_MAGIC, _WHOLE, _HDF5 = b"Ogawa", 0xFF, b"\x89HDF"
_SAME_TIME = 1e-6  # seconds
_EXISTING = Abc.WrapExistingFlag.kWrapExisting
_NEAREST = Abc.ISampleSelector.TimeIndexType.kNearIndex


class _Sampled:
    """A property or a transform, and the seconds of its samples."""

    def __init__(self, values: Any) -> None:
        self.values = values
        sampling = values.getTimeSampling()
        self.times = np.array([sampling.getSampleTime(number) for number in range(values.getNumSamples())])

    def at(self, sample: int) -> Any:
        # By its time: the binding takes the number of a sample for seconds, too.
        return self.values.getValue(Abc.ISampleSelector(float(self.times[sample]), _NEAREST))


class AlembicScene:
    """An archive that is open.

    Args:
        path: the file.

    Raises:
        InputError: no archive in the form that is written today, or one that was not written to its end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            start = file.read(8)
        if start.startswith(_HDF5):
            raise InputError(
                f"{path}: an Alembic file of the old HDF5 kind; convert it with `abcconvert -toOgawa`"
            )
        if not start.startswith(_MAGIC):
            raise InputError(f"{path}: not an Alembic file, which begins with Ogawa")
        if len(start) < 8 or start[5] != _WHOLE:
            raise InputError(f"{path}: it was not written to its end; export it again")
        self._archive = Abc.IArchive(str(path))
        self._meshes = {mesh.getFullName(): mesh for mesh in _meshes(self._archive.getTop())}

    def names(self, *, hidden: bool) -> list[str]:
        """Paths of the meshes; those hidden only if `hidden`."""
        return [
            name
            for name, mesh in self._meshes.items()
            if hidden or not AbcGeom.IsAncestorInvisible(mesh, Abc.ISampleSelector())
        ]

    def mesh(self, name: str) -> SceneMesh:
        """The mesh of a path.

        Raises:
            InputError: polygons or texture coordinates that do not fit together, or no points.
        """
        node, source = self._meshes[name], f"{self.path}: {name}"
        schema = _schema(node)
        positions, counts, indices = (
            _Sampled(schema.getPositionsProperty()),
            _Sampled(schema.getFaceCountsProperty()),
            _Sampled(schema.getFaceIndicesProperty()),
        )
        if not (len(positions.times) and len(counts.times) and len(indices.times)):
            raise InputError(f"{source}: it has no points")
        if (
            hasattr(schema, "getHolesProperty")
            and schema.getHolesProperty().valid()
            and len(schema.getHolesProperty().getValue())
        ):
            raise InputError(f"{source}: it has holes, which are not read; delete those faces")
        parents = _parents(node)
        times = _times([positions, counts, indices, *parents])
        polygons = Polygons(_at(counts, times[0]), _at(indices, times[0]), source)
        first = _interpolated(positions, times[0], source)
        changing = not (counts.values.isConstant() and indices.values.isConstant())

        def points(seconds: float, frame: int) -> np.ndarray:
            local = _interpolated(positions, seconds, source)
            check_same(polygons, len(first), local, f"in frame {frame}")
            if changing and not polygons.same(_at(counts, seconds), _at(indices, seconds)):
                raise InputError(
                    f"{source}: other polygons in frame {frame} than in the first; every frame must be the same mesh"
                )
            placed = _to_world(parents, seconds)
            return in_world(local, placed)

        mirrored = bool(np.linalg.det(_to_world(parents, times[0])[:3, :3]) < 0)
        return SceneMesh(name, polygons, times, points, not mirrored, _look(schema, polygons, len(first)))


def _meshes(node: Any) -> list[Any]:
    """Polygon meshes and subdivision cages below an object, in the file's order."""
    found = []
    for number in range(node.getNumChildren()):
        child = node.getChild(number)
        header = child.getHeader()
        if AbcGeom.IPolyMesh.matches(header) or AbcGeom.ISubD.matches(header):
            found.append(child)
        found += _meshes(child)
    return found


def _schema(node: Any) -> Any:
    kind = AbcGeom.IPolyMesh if AbcGeom.IPolyMesh.matches(node.getHeader()) else AbcGeom.ISubD
    return kind(node, _EXISTING).getSchema()


def _parents(node: Any) -> list[_Sampled]:
    """The transforms above an object that place it, the innermost first."""
    found = []
    node = node.getParent()
    while node.valid() and node.getFullName() != "/":
        if AbcGeom.IXform.matches(node.getHeader()):
            schema = AbcGeom.IXform(node, _EXISTING).getSchema()
            if schema.getNumSamples():
                found.append(_Sampled(schema))
            if schema.getNumSamples() and not schema.getInheritsXforms():
                break
        node = node.getParent()
    return found


def _times(properties: list[_Sampled]) -> np.ndarray:
    """Seconds at which any of the properties has a sample of its own; those of one sample are always so."""
    moving = [values.times for values in properties if len(values.times) > 1]
    if not moving:
        return properties[0].times[:1]
    rising = np.unique(np.concatenate(moving))
    kept: np.ndarray = rising[np.concatenate([[True], np.diff(rising) > _SAME_TIME])]
    return kept


def _around(values: _Sampled, seconds: float) -> tuple[int, int, float]:
    """The samples before and after a time, and how far it is from the first to the second (0 to 1)."""
    times = values.times
    after = min(int(np.searchsorted(times, seconds - _SAME_TIME)), len(times) - 1)
    if after == 0 or times[after] <= seconds + _SAME_TIME:
        return after, after, 0.0
    start, end = times[after - 1], times[after]
    return after - 1, after, float((seconds - start) / (end - start))


def _at(values: _Sampled, seconds: float) -> np.ndarray:
    """(C,) int64 of an array of integers at a time: that of the sample before."""
    return np.array(values.at(_around(values, seconds)[0]), np.int64)


def _interpolated(positions: _Sampled, seconds: float, source: str) -> np.ndarray:
    """(N, 3) float64 points at a time, on straight lines between samples."""
    before, after, weight = _around(positions, seconds)
    start = _vectors(positions.at(before), 3, np.float64)
    if not len(start):
        raise InputError(f"{source}: it has no points")
    if weight == 0:
        return start
    end = _vectors(positions.at(after), 3, np.float64)
    return start if len(end) != len(start) else (1 - weight) * start + weight * end


def _to_world(parents: list[_Sampled], seconds: float) -> np.ndarray:
    """(4, 4) for row vectors, as Alembic has it: world = local @ matrix."""
    placed = np.eye(4)
    for schema in parents:
        before, after, weight = _around(schema, seconds)
        matrix = _matrix(schema, before)
        if weight:
            matrix = (1 - weight) * matrix + weight * _matrix(schema, after)
        placed = placed @ matrix
    return placed


def _matrix(schema: _Sampled, sample: int) -> np.ndarray:
    matrix = schema.at(sample).getMatrix()
    return np.array([[matrix[row][column] for column in range(4)] for row in range(4)])


def _vectors(values: Any, width: int, dtype: type) -> np.ndarray:
    return np.array(values, dtype).reshape(-1, width)


def _look(schema: Any, polygons: Polygons, n_vertices: int) -> Look:
    sets = []
    for name in schema.getFaceSetNames():
        values = schema.getFaceSet(name).getSchema()
        if values.getNumSamples():
            sets.append((str(name), np.array(values.getValue().getFaces(), np.int64)))
    materials = face_sets(len(polygons.counts), sets, polygons.source)
    texture = _texture(schema.getUVsParam(), polygons, n_vertices)
    return materials if texture is None else Look(*texture, materials.materials, materials.polygon_materials)


def _texture(param: Any, polygons: Polygons, n_vertices: int) -> tuple[np.ndarray, np.ndarray] | None:
    """(U, 2) texture coordinates, and which of them each corner has; None where there are none."""
    if not param.valid() or not param.getNumSamples():
        return None
    sample, scope = param.getIndexedValue(), param.getScope()
    uvs = _vectors(sample.getVals(), 2, np.float32)
    if scope == AbcGeom.GeometryScope.kFacevaryingScope:
        places, wanted = np.arange(len(polygons.vertices)), len(polygons.vertices)
    elif scope in (AbcGeom.GeometryScope.kVertexScope, AbcGeom.GeometryScope.kVaryingScope):
        places, wanted = polygons.vertices, n_vertices
    else:
        return None
    indices = np.array(list(sample.getIndices()), np.int64)
    if len(indices) != wanted or not (indices.min() >= 0 and indices.max() < len(uvs)):
        raise InputError(
            f"{polygons.source}: texture coordinates have {len(indices)} indices into {len(uvs)}, but {wanted} are "
            "wanted"
        )
    return uvs, indices[places]
