"""USD stages (.usd, .usda, .usdc, .usdz), through usd-core; meshes in metres and axes that the stage states.

Facts of the format: the documentation of UsdGeom (openusd.org): Mesh, Gprim (orientation: the winding of polygons,
which a transform that mirrors turns round), Subset, Primvar, the stage's metersPerUnit (a centimetre where it says
nothing) and upAxis; and of UsdSkel for bodies that a skeleton moves.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel

from render.errors import InputError
from render.files.scenes.objects import Look, SceneMesh, check_same, face_sets, in_world
from render.files.scenes.polygons import Polygons

_UV_NAMES = ("st", "UVMap", "uv", "map1", "st0")  # what exporters call the first set
_UV_TYPES = (
    Sdf.ValueTypeNames.TexCoord2fArray,
    Sdf.ValueTypeNames.TexCoord2dArray,
    Sdf.ValueTypeNames.TexCoord2hArray,
)
_UV_LOOSE_TYPES = (Sdf.ValueTypeNames.Float2Array, Sdf.ValueTypeNames.Double2Array)


class UsdScene:
    """A stage that is open.

    Args:
        path: the file; layers that it refers to are read, too.

    Raises:
        InputError: a stage that names layers that are not there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._stage = Usd.Stage.Open(str(path))
        except Tf.ErrorException as error:
            said = re.findall(
                r": '([^'\n]*)'", str(error)
            )  # between them stand places in the library's source
            raise InputError(
                f"{path}: cannot be read, is it damaged? ({said[0] if said else 'no USD file'})"
            ) from None
        if errors := self._stage.GetCompositionErrors():
            raise InputError(f"{path}: what it refers to cannot be read: {errors[0]}")
        _bake_skeletons(self._stage)

    def names(self, *, hidden: bool) -> list[str]:
        """Paths of the meshes; those hidden, or made for other purposes than rendering, only if `hidden`."""
        return [str(prim.GetPath()) for prim in self._meshes() if hidden or _is_seen(prim)]

    def mesh(self, name: str) -> SceneMesh:
        """The mesh of a path.

        Raises:
            InputError: polygons or texture coordinates that do not fit together, or no points.
        """
        prim = self._stage.GetPrimAtPath(name)
        mesh, source = UsdGeom.Mesh(prim), f"{self.path}: {name}"
        times = _times(prim)
        rate = self._stage.GetTimeCodesPerSecond()
        start = Usd.TimeCode(times[0]) if len(times) else Usd.TimeCode.EarliestTime()
        polygons = Polygons(*_polygons(mesh, start), source)
        if len(mesh.GetHoleIndicesAttr().Get(start) or ()):
            raise InputError(f"{source}: it has holes (holeIndices), which are not read; delete those faces")
        n_vertices = len(_points(mesh, start, source))
        changing = any(
            attribute.ValueMightBeTimeVarying()
            for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
        )

        def points(seconds: float, frame: int) -> np.ndarray:
            time = Usd.TimeCode(seconds * rate) if len(times) else start
            local = _points(mesh, time, source)
            check_same(polygons, n_vertices, local, f"in frame {frame}")
            if changing and not polygons.same(*_polygons(mesh, time)):
                raise InputError(
                    f"{source}: other polygons in frame {frame} than in the first; every frame must be the same mesh"
                )
            placed = _to_world(prim, time)
            return in_world(local, placed)

        mirrored = bool(np.linalg.det(_to_world(prim, start)[:3, :3]) < 0)
        left_handed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
        return SceneMesh(
            name,
            polygons,
            np.array(times if len(times) else [0.0]) / rate,
            points,
            mirrored != left_handed,
            _look(mesh, polygons, n_vertices, start),
            rate,
            str(UsdGeom.GetStageUpAxis(self._stage)).lower(),
            float(UsdGeom.GetStageMetersPerUnit(self._stage)),
        )

    def _meshes(self) -> list[Any]:
        """Meshes where they stand in the scene, those of instances too; not those that a PointInstancer scatters."""
        found = []
        walk = iter(Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies()))
        for prim in walk:
            if prim.IsA(UsdGeom.PointInstancer):
                walk.PruneChildren()
            elif prim.IsA(UsdGeom.Mesh):
                found.append(prim)
        return found


def _is_seen(prim: Any) -> bool:
    imageable = UsdGeom.Imageable(prim)
    seen = imageable.ComputeVisibility(Usd.TimeCode.EarliestTime()) != UsdGeom.Tokens.invisible
    return seen and imageable.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)


def _bake_skeletons(stage: Any) -> None:
    """Let skeletons and blend shapes move the points themselves, in a layer that is not saved."""
    roots = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Root)]
    if not roots:
        return
    layer = stage.GetSessionLayer()
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # else times in it are scaled
    stage.SetEditTarget(layer)
    for prim in roots:
        UsdSkel.BakeSkinning(UsdSkel.Root(prim), Gf.Interval.GetFullInterval())


def _times(prim: Any) -> list[float]:
    """Time codes at which the points, the polygons or a parent's transform have values."""
    mesh = UsdGeom.Mesh(prim)
    times = {
        time
        for attribute in (
            mesh.GetPointsAttr(),
            mesh.GetFaceVertexCountsAttr(),
            mesh.GetFaceVertexIndicesAttr(),
        )
        if attribute.GetNumTimeSamples() > 1
        for time in attribute.GetTimeSamples()
    }
    above = prim
    while above:
        if (placed := UsdGeom.Xformable(above)) and placed.TransformMightBeTimeVarying():
            times.update(placed.GetTimeSamples())
        above = above.GetParent()
    return sorted(times)


def _points(mesh: Any, time: Any, source: str) -> np.ndarray:
    values = mesh.GetPointsAttr().Get(time)
    if values is None or not len(values):
        raise InputError(f"{source}: it has no points")
    return np.array(values, np.float64)


def _polygons(mesh: Any, time: Any) -> tuple[np.ndarray, np.ndarray]:
    both = (mesh.GetFaceVertexCountsAttr().Get(time), mesh.GetFaceVertexIndicesAttr().Get(time))
    counts, indices = (np.array(() if values is None else values, np.int64) for values in both)
    return counts, indices


def _to_world(prim: Any, time: Any) -> np.ndarray:
    """(4, 4) for row vectors, as USD has it: world = local @ matrix."""
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time), np.float64)


def _look(mesh: Any, polygons: Polygons, n_vertices: int, time: Any) -> Look:
    look = _materials(mesh, polygons, time)
    uvs = _texture(mesh, polygons, n_vertices, time)
    if uvs is None:
        return look
    return Look(*uvs, look.materials, look.polygon_materials)


def _texture(
    mesh: Any, polygons: Polygons, n_vertices: int, time: Any
) -> tuple[np.ndarray, np.ndarray] | None:
    """(U, 2) texture coordinates, and which of them each corner has; None where there are none."""
    primvar = _uv_primvar(mesh)
    values = primvar.Get(time) if primvar else None
    if values is None or not len(values):
        return None
    kind = primvar.GetInterpolation()
    uvs = np.array(values, np.float32).reshape(-1, 2)
    if kind == UsdGeom.Tokens.faceVarying:
        places = np.arange(len(polygons.vertices))
    elif kind in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        places = polygons.vertices
    else:
        return None
    wanted = len(places) if kind == UsdGeom.Tokens.faceVarying else n_vertices
    indices = np.array(primvar.GetIndices(time), np.int64) if primvar.IsIndexed() else np.arange(len(uvs))
    if len(indices) != wanted or not (indices.min() >= 0 and indices.max() < len(uvs)):
        raise InputError(
            f"{polygons.source}: texture coordinates {primvar.GetPrimvarName()} ({kind}) have {len(indices)} indices "
            f"into {len(uvs)}, but {wanted} are wanted"
        )
    return uvs, indices[places]


def _uv_primvar(mesh: Any) -> Any:
    """The first set of texture coordinates: by its usual names, else by its type."""
    primvars = [
        primvar
        for primvar in UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance()
        if primvar.HasAuthoredValue()
    ]
    typed = [primvar for primvar in primvars if primvar.GetTypeName() in _UV_TYPES]
    loose = [primvar for primvar in primvars if primvar.GetTypeName() in (*_UV_TYPES, *_UV_LOOSE_TYPES)]
    for name in _UV_NAMES:
        for primvar in loose:
            if primvar.GetPrimvarName() == name:
                return primvar
    return typed[0] if typed else None


def _materials(mesh: Any, polygons: Polygons, time: Any) -> Look:
    """Materials of the subsets that bind them, and of the mesh for what is in no subset."""
    own = _bound(mesh.GetPrim())
    sets = [] if own is None else [(own, np.arange(len(polygons.counts)))]
    for subset in UsdShade.MaterialBindingAPI(mesh.GetPrim()).GetMaterialBindSubsets():
        indices = np.array(subset.GetIndicesAttr().Get(time) or (), np.int64)
        sets.append((_bound(subset.GetPrim()) or subset.GetPrim().GetName(), indices))
    return face_sets(len(polygons.counts), sets, polygons.source)


def _bound(prim: Any) -> str | None:
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    return material.GetPrim().GetName() if material else None
