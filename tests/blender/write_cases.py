"""Run by Blender's own Python (`bpy`): has Blender export one scene in every format and option, beside the truth.

    python write_cases.py OUT [CASE...]

The scene is an open cylinder of quads with a texture seam and two materials ("tube"), moved, turned and scaled as an
object, and a small box beside it that "selected only" leaves out. OUT/truth.npz holds the tube as Blender has it, in
metres, z up and world coordinates; OUT/<case> is what an exporter wrote. A function here is a case, named after it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import bpy
import numpy as np

AROUND, ALONG = 7, 3
CASES: dict[str, Callable[[Path], None]] = {}


def case(name: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    """Register what writes a file or folder of this name."""

    def registered(write: Callable[[Path], None]) -> Callable[[Path], None]:
        CASES[name] = write
        return write

    return registered


def build_scene() -> Any:
    """An empty file, then the tube (active and selected) and the box; returns the tube's object."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    columns = [2 * pi * column / AROUND for column in range(AROUND)]
    vertices = [
        ((0.3 + 0.02 * row) * cos(angle), 0.25 * sin(angle), 0.2 * row + 0.01 * column)
        for row in range(ALONG)
        for column, angle in enumerate(columns)
    ]
    ring = AROUND
    quads = [
        (row * ring + a, row * ring + (a + 1) % ring, (row + 1) * ring + (a + 1) % ring, (row + 1) * ring + a)
        for row in range(ALONG - 1)
        for a in range(AROUND)
    ]  # fmt: skip
    mesh = bpy.data.meshes.new("tube")
    mesh.from_pydata(vertices, [], quads)
    for name, colour in (("red cloth", (1, 0, 0, 1)), ("blue", (0, 0, 1, 1))):
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
        mesh.materials.append(material)
    uvs = mesh.uv_layers.new(name="UVMap").data
    for polygon in mesh.polygons:
        polygon.material_index = polygon.index % 2
        column, row = polygon.index % AROUND, polygon.index // AROUND
        for corner, loop in enumerate(polygon.loop_indices):  # the last column ends at 1: a seam
            uvs[loop].uv = (
                (column + (corner in (1, 2))) / AROUND,
                (row + (corner in (2, 3))) / (ALONG - 1),
            )
    tube = bpy.data.objects.new("tube", mesh)
    tube.location, tube.rotation_euler, tube.scale = (0.1, -0.2, 1.0), (0.3, 0.1, -0.4), (1.0, 2.0, 1.5)
    bpy.context.collection.objects.link(tube)
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(3, 0, 0))
    box = bpy.context.object
    box.select_set(False)
    tube.select_set(True)
    bpy.context.view_layer.objects.active = tube
    return tube


def write_truth(path: Path, tube: Any) -> None:
    """`vertices` (N, 3) of the world, `quads` (F, 4), `uvs` (F, 4, 2), `materials` (F,), `names`, `triangles` (T, 3)
    as Blender cuts the quads."""
    bpy.context.view_layer.update()
    mesh = tube.data
    mesh.calc_loop_triangles()
    uvs = np.array([loop.uv for loop in mesh.uv_layers[0].data])
    np.savez(
        path,
        vertices=np.array([tube.matrix_world @ vertex.co for vertex in mesh.vertices]),
        quads=np.array([polygon.vertices for polygon in mesh.polygons]),
        uvs=uvs[np.array([list(polygon.loop_indices) for polygon in mesh.polygons])],
        materials=np.array([polygon.material_index for polygon in mesh.polygons]),
        names=np.array([material.name for material in mesh.materials]),
        triangles=np.array([triangle.vertices for triangle in mesh.loop_triangles]),
    )


def _obj(path: Path, **options: Any) -> None:
    bpy.ops.wm.obj_export(filepath=str(path), export_selected_objects=True, **options)


def _ply(path: Path, **options: Any) -> None:
    bpy.ops.wm.ply_export(filepath=str(path), export_selected_objects=True, **options)


def _glb(path: Path, **options: Any) -> None:
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB", use_selection=True, **options)


@case("quads.obj")
def _quads_obj(path: Path) -> None:
    _obj(path)


@case("triangles.obj")
def _triangles_obj(path: Path) -> None:
    _obj(path, export_triangulated_mesh=True, export_object_groups=True, export_material_groups=True)


@case("z_up.obj")
def _z_up_obj(path: Path) -> None:
    _obj(path, forward_axis="Y", up_axis="Z", export_smooth_groups=True, export_colors=True)


@case("bare.obj")
def _bare_obj(path: Path) -> None:
    _obj(path, export_uv=False, export_normals=False, export_materials=False)


@case("all_objects.obj")
def _all_objects_obj(path: Path) -> None:
    bpy.ops.wm.obj_export(filepath=str(path))


@case("subdivided.obj")
def _subdivided_obj(path: Path) -> None:
    modifier = bpy.context.object.modifiers.new("more", "SUBSURF")
    modifier.levels = 1
    _obj(path, apply_modifiers=True)
    bpy.context.object.modifiers.clear()


@case("binary.ply")
def _binary_ply(path: Path) -> None:
    _ply(path, ascii_format=False)


@case("ascii.ply")
def _ascii_ply(path: Path) -> None:
    _ply(path, ascii_format=True, export_normals=True)


@case("triangles.ply")
def _triangles_ply(path: Path) -> None:
    _ply(path, export_triangulated_mesh=True, export_uv=False)


@case("y_up.ply")
def _y_up_ply(path: Path) -> None:
    _ply(path, forward_axis="NEGATIVE_Z", up_axis="Y", export_uv=False, export_attributes=True)


@case("tube.glb")
def _tube_glb(path: Path) -> None:
    _glb(path)


@case("z_up.glb")
def _z_up_glb(path: Path) -> None:
    _glb(path, export_yup=False, export_normals=False)


@case("shared.glb")
def _shared_glb(path: Path) -> None:
    _glb(path, export_shared_accessors=True)


@case("draco.glb")
def _draco_glb(path: Path) -> None:
    _glb(path, export_draco_mesh_compression_enable=True)


@case("tube.gltf")
def _tube_gltf(path: Path) -> None:
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLTF_SEPARATE", use_selection=True)


def main(out: Path, names: list[str]) -> None:
    """Write the named cases, all if none is named; each from a scene of its own."""
    out.mkdir(parents=True, exist_ok=True)
    for name in names or list(CASES):
        tube = build_scene()
        write_truth(out / "truth.npz", tube)
        CASES[name](out / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
