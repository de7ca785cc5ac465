"""Small Alembic and USD files, written with the formats' own libraries; skipped where Alembic's has no package."""

from __future__ import annotations

import importlib
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if sys.platform == "linux" and platform.machine() != "x86_64":
    pytest.skip("alembic3d has no package for this processor", allow_module_level=True)
imath, alembic3d = importlib.import_module("imath"), importlib.import_module("alembic3d")
Abc, AbcGeom, Core = alembic3d.Abc, alembic3d.AbcGeom, alembic3d.AbcCoreAbstract
Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, Vt = (
    importlib.import_module(f"pxr.{name}")
    for name in ("Gf", "Sdf", "Usd", "UsdGeom", "UsdShade", "UsdSkel", "UsdUtils", "Vt")
)

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)  # faces +z, read counter-clockwise


@dataclass(frozen=True)
class Written:
    """One mesh of a scene.

    Args:
        frames: (T, N, 3) points. seconds: (T,) when each is; one frame is still.
        counts, corners: its polygons, counter-clockwise seen from outside.
        uvs, uv_corners: texture coordinates, and which of them each corner has.
        sets: named sets of polygons.
    """

    frames: np.ndarray
    seconds: Sequence[float] = (0.0,)
    counts: Sequence[int] = (4,)
    corners: Sequence[int] = (0, 1, 2, 3)
    uvs: np.ndarray | None = None
    uv_corners: Sequence[int] = ()
    sets: tuple[tuple[str, Sequence[int]], ...] = ()


Placed = Sequence[tuple[float, np.ndarray]]  # (4, 4) matrices for row vectors, and their seconds


def write_usd(
    path: Path,
    meshes: dict[str, Written],
    transforms: dict[str, Placed] | None = None,
    *,
    metres: float = 1.0,
    up: str = "Y",
    rate: float = 24.0,
) -> Any:
    """Write a stage with meshes by path, and transforms by path; returns it, still open."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, up)
    stage.SetTimeCodesPerSecond(rate)
    for name, placed in (transforms or {}).items():
        operation = UsdGeom.Xform.Define(stage, name).AddTransformOp()
        for seconds, matrix in placed:
            time = seconds * rate if len(placed) > 1 else Usd.TimeCode.Default()
            operation.Set(Gf.Matrix4d(*np.asarray(matrix, float).ravel().tolist()), time)
    for name, written in meshes.items():
        mesh = UsdGeom.Mesh.Define(stage, name)
        mesh.CreateFaceVertexCountsAttr(list(written.counts))
        mesh.CreateFaceVertexIndicesAttr(list(written.corners))
        points = mesh.CreatePointsAttr()
        for seconds, frame in zip(written.seconds, written.frames, strict=True):
            time = seconds * rate if len(written.frames) > 1 else Usd.TimeCode.Default()
            points.Set(Vt.Vec3fArray.FromNumpy(np.asarray(frame, np.float32)), time)
        if written.uvs is not None:
            kind = Sdf.ValueTypeNames.TexCoord2fArray
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
            primvar.Set(Vt.Vec2fArray.FromNumpy(np.asarray(written.uvs, np.float32)))
            primvar.SetIndices(Vt.IntArray(list(written.uv_corners)))
        for label, polygons in written.sets:
            material = UsdShade.Material.Define(stage, f"/materials/{label}")
            api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
            subset = api.CreateMaterialBindSubset(f"part_{label}", Vt.IntArray(list(polygons)))
            UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    stage.Save()
    return stage


def write_abc(
    path: Path,
    meshes: dict[str, Written],
    transforms: dict[str, Placed] | None = None,
    *,
    subdivision: bool = False,
    hidden: tuple[str, ...] = (),
) -> None:
    """Write an archive with meshes by path; what lies above them are transforms, those not given without any."""
    archive = Abc.OArchive(str(path))
    nodes: dict[str, Any] = {"": archive.getTop()}
    transforms = transforms or {}

    def above(name: str) -> Any:
        if name not in nodes:
            parent, _, last = name.rpartition("/")
            placed = transforms.get(name, ())
            nodes[name] = AbcGeom.OXform(above(parent), last)
            schema = nodes[name].getSchema()
            if len(placed) > 1:
                schema.setTimeSampling(_sampling([seconds for seconds, _ in placed]))
            for _, matrix in placed:
                sample = AbcGeom.XformSample()
                sample.setMatrix(imath.M44d(*np.asarray(matrix, float).ravel().tolist()))
                schema.set(sample)
        return nodes[name]

    for name, written in meshes.items():
        parent, _, last = name.rpartition("/")
        kind = AbcGeom.OSubD if subdivision else AbcGeom.OPolyMesh
        node = kind(above(parent), last)
        if name in hidden:
            AbcGeom.CreateVisibilityProperty(node, 0).setValue(0)
        _fill(node.getSchema(), written, subdivision=subdivision)
    nodes.clear()  # `above` keeps itself and them; the file ends with its objects


def _fill(schema: Any, written: Written, *, subdivision: bool) -> None:
    if len(written.frames) > 1:
        schema.setTimeSampling(_sampling(written.seconds))
    order = _turned(written.counts)  # Alembic's polygons are clockwise
    for frame in written.frames:
        kind = AbcGeom.OSubDSchemaSample if subdivision else AbcGeom.OPolyMeshSchemaSample
        arguments = [
            imath.V3fArrayFromBuffer(np.ascontiguousarray(frame, np.float32)),
            _ints(np.asarray(written.corners)[order]),
            _ints(written.counts),
        ]
        if written.uvs is not None:
            indices = imath.UnsignedIntArray(len(order))
            for place, index in enumerate(np.asarray(written.uv_corners)[order].tolist()):
                indices[place] = index
            values = imath.V2fArrayFromBuffer(np.ascontiguousarray(written.uvs, np.float32))
            scope = AbcGeom.GeometryScope.kFacevaryingScope
            arguments.append(AbcGeom.OV2fGeomParamSample(values, indices, scope))
        schema.set(kind(*arguments))
    for label, polygons in written.sets:
        face_set = schema.createFaceSet(label).getSchema()
        face_set.set(AbcGeom.OFaceSetSchemaSample(_ints(polygons)))


def _turned(counts: Sequence[int]) -> np.ndarray:
    """For each corner the one that takes its place when every polygon is read backwards."""
    starts = np.cumsum([0, *counts[:-1]])
    return np.concatenate(
        [np.arange(start + count - 1, start - 1, -1) for start, count in zip(starts, counts, strict=True)]
    )


def _ints(values: Any) -> Any:
    return imath.IntArrayFromBuffer(np.ascontiguousarray(values, np.int32))


def _sampling(seconds: Sequence[float]) -> Any:
    times = Core.TimeVector()
    for time in seconds:
        times.append(float(time))
    return Core.TimeSampling(Core.TimeSamplingType(Core.AcyclicFlag.kAcyclic), times)
