"""A moving clip as a USD stage, through usd-core: points as time samples, in metres, y up.

Facts of the format: the documentation of UsdGeom and UsdPreviewSurface (openusd.org). Polygons are not subdivided.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from imgtransfer.data.clip import Clip
from imgtransfer.data.texture_files import store_texture, writer_into
from imgtransfer.exports.materials import Material, parts_of
from imgtransfer.exports.objects import COLOURS, MovingObject, objects_of
from imgtransfer.exports.room import check_room
from render import InputError
from render.files.atomic import written_whole

_ROOT = "/clip"


@contextmanager
def written_usd(path: Path, *, n_frames: int, step: int = 1) -> Iterator[Callable[[Clip], None]]:
    """Yield what takes the frames of a clip, some at a time; see `written_animation`.

    Time codes are the clip's frame numbers, from 0, and the stage says how many of them a second has. Textures are
    copied into textures/ beside the file, or into the .usdz.

    Args:
        path: ends in .usd or .usdc (binary), .usda (text) or .usdz (with its textures in one file).
        n_frames: that will come, T. step: what their numbers in the clip count by.

    Raises:
        InputError: USD could not write it; where the disk is full mostly an OSError comes first.
    """
    with written_whole(path) as temporary, _errors_naming(path):
        if path.suffix.lower() != ".usdz":
            stage = _Stage(temporary, path.parent, n_frames, step)
            yield stage.add
            stage.save()
            return
        with TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}-") as folder:
            layer = Path(folder) / f"{path.stem}.usdc"
            stage = _Stage(layer, layer.parent, n_frames, step)
            yield stage.add
            stage.save()
            packed = Path(folder) / "packed.usdz"
            if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(packed)):
                raise InputError(f"{path}: USD could not pack the stage and its textures into one file")
            shutil.copyfile(packed, temporary)


@contextmanager
def _errors_naming(path: Path) -> Iterator[None]:
    try:
        yield
    except Tf.ErrorException as error:
        said = str(error).strip().splitlines()[-1].split(" : ")[-1]  # it begins with places in USD's source
        raise InputError(f"{path}: USD could not write it: {said}") from error


class _Stage:
    """A stage that grows frame by frame; what was added is on the disk after each part, but for .usda.

    Args:
        file: to write. folder: that textures are named from.
    """

    def __init__(self, file: Path, folder: Path, n_frames: int, step: int) -> None:
        self.file, self.folder, self.step, self.done = file, folder, step, 0
        self.last = (n_frames - 1) * step
        self.stage = Usd.Stage.CreateNew(str(file))
        self.meshes: dict[str, Any] = {}
        self.binary = file.suffix.lower() != ".usda"

    def add(self, part: Clip) -> None:
        """Add the next frames."""
        if not self.meshes:
            self._begin(part)
        check_room(self.file, self._size(part))
        for thing in objects_of(part):
            mesh = self.meshes[thing.name]
            points, extent = mesh.GetPointsAttr(), mesh.GetExtentAttr()
            for number, frame in enumerate(thing.of_file(part), start=self.done):
                time = Usd.TimeCode(number * self.step)
                points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(frame, np.float32)), time)
                extent.Set(Vt.Vec3fArray.FromNumpy(np.stack([frame.min(0), frame.max(0)])), time)
        self.done += part.n_frames
        if self.binary:
            self.stage.Save()

    def _size(self, part: Clip) -> int:
        """About how many bytes the file grows by: polygons with the first part, points with each."""
        counts = [(len(thing.surface.vertices), len(thing.surface.faces)) for thing in objects_of(part)]
        per_number = 4 if self.binary else 14
        return sum(
            per_number * (3 * vertices * part.n_frames + (0 if self.done else 8 * faces))
            for vertices, faces in counts
        )

    def save(self) -> None:
        """Write what is left, and let go of the file."""
        self.stage.Save()
        del self.stage, self.meshes

    def _begin(self, part: Clip) -> None:
        stage = self.stage
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        stage.SetTimeCodesPerSecond(part.fps)
        stage.SetFramesPerSecond(part.fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(self.last)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, _ROOT).GetPrim())
        for thing in objects_of(part):
            self.meshes[thing.name] = self._mesh(thing)

    def _mesh(self, thing: MovingObject) -> Any:
        surface = thing.surface
        mesh = UsdGeom.Mesh.Define(self.stage, f"{_ROOT}/{thing.name}")
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(thing.name == "garment")
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(surface.faces), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(surface.faces.astype(np.int32).ravel()))
        mesh.CreatePointsAttr()
        mesh.CreateExtentAttr()
        if surface.uvs is not None and surface.uv_faces is not None:
            # A corner without a coordinate gets one of its own at the end.
            uvs = np.concatenate([surface.uvs, np.zeros((1, 2))]).astype(np.float32)
            kind = Sdf.ValueTypeNames.TexCoord2fArray
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
            primvar.Set(Vt.Vec2fArray.FromNumpy(uvs))
            corners = np.where(surface.uv_faces < 0, len(surface.uvs), surface.uv_faces)
            primvar.SetIndices(Vt.IntArray.FromNumpy(corners.astype(np.int32).ravel()))
        self._bind(mesh, thing)
        return mesh

    def _bind(self, mesh: Any, thing: MovingObject) -> None:
        binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        parts = parts_of(thing.name, thing.surface)
        for number, (material, faces) in enumerate(parts):
            shaded = self._material(material, thing.name)
            if len(parts) == 1:
                binding.Bind(shaded)
            else:
                chosen = Vt.IntArray.FromNumpy(faces.astype(np.int32))
                subset = binding.CreateMaterialBindSubset(f"part_{number}", chosen)
                UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(shaded)

    def _material(self, material: Material, object_name: str) -> Any:
        """A preview surface, of the object's colour where no other is described.

        Its path has a name that USD allows, its display name is the material's own.
        """
        name, number = Tf.MakeValidIdentifier(material.name), 1
        place = f"{_ROOT}/materials/{name}"
        while self.stage.GetPrimAtPath(place):
            number += 1
            place = f"{_ROOT}/materials/{name}_{number}"
        made = UsdShade.Material.Define(self.stage, place)
        made.GetPrim().SetDisplayName(material.name)
        shader = _shader(self.stage, f"{place}/surface", "UsdPreviewSurface")
        made.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.85)
        shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(float(material.opacity))
        colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
        if material.image is None:
            colour.Set(Gf.Vec3f(*(material.colour or COLOURS[object_name][:3])))
        else:
            colour.ConnectToSource(self._texture(place, material.image).ConnectableAPI(), "rgb")
        return made

    def _texture(self, place: str, image: Path) -> Any:
        reader = _shader(self.stage, f"{place}/st", "UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture = _shader(self.stage, f"{place}/texture", "UsdUVTexture")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.ConnectableAPI(), "result"
        )
        asset = Sdf.AssetPath(f"./{store_texture(image, writer_into(self.folder))}")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(asset)
        for side in ("wrapS", "wrapT"):
            texture.CreateInput(side, Sdf.ValueTypeNames.Token).Set("repeat")
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        return texture


def _shader(stage: Any, place: str, kind: str) -> Any:
    shader = UsdShade.Shader.Define(stage, place)
    shader.CreateIdAttr(kind)
    return shader
