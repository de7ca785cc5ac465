"""Run by Blender's own Python (`bpy`): has Blender export meshes in motion as Alembic and USD, beside the truth.

    python write_scenes.py OUT

"cloth" is a tube of quads with a texture seam and two materials, deformed by a keyed shape, below an empty that is
moved, turned and scaled over time; "body" is a box that a bone bends; "mirrored" is a still copy of the tube at scale
-1. OUT/truth.npz holds each in FRAMES as Blender has it: metres, z up, world coordinates.
"""

from __future__ import annotations

import sys
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import bpy
import numpy as np

FRAMES = range(1, 6)
AROUND, ALONG = 7, 3


def _tube() -> Any:
    columns = [2 * pi * column / AROUND for column in range(AROUND)]
    vertices = [
        ((0.3 + 0.02 * row) * cos(angle), 0.25 * sin(angle), 0.2 * row + 0.01 * column)
        for row in range(ALONG)
        for column, angle in enumerate(columns)
    ]
    ring = [(a, (a + 1) % AROUND) for a in range(AROUND)]
    rows = [(row * AROUND, (row + 1) * AROUND) for row in range(ALONG - 1)]
    quads = [(low + a, low + b, high + b, high + a) for low, high in rows for a, b in ring]
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(vertices, [], quads)
    for name in ("red", "blue"):
        mesh.materials.append(bpy.data.materials.new(name))
    uvs = mesh.uv_layers.new(name="UVMap").data
    for polygon in mesh.polygons:
        polygon.material_index = polygon.index % 2
        column, row = polygon.index % AROUND, polygon.index // AROUND
        for corner, loop in enumerate(polygon.loop_indices):  # the last column ends at 1: a seam
            uvs[loop].uv = (column + (corner in (1, 2))) / AROUND, (row + (corner in (2, 3))) / (ALONG - 1)
    return mesh


def build() -> None:
    """The scene, from an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, link = bpy.context.scene, bpy.context.collection.objects.link
    scene.frame_start, scene.frame_end, scene.render.fps = FRAMES[0], FRAMES[-1], 25
    mesh = _tube()
    cloth = bpy.data.objects.new("cloth", mesh)
    mirrored = bpy.data.objects.new("mirrored", mesh.copy())
    mirrored.location, mirrored.scale = (2, 0, 0), (-1, 1, 1)
    empty = bpy.data.objects.new("carrier", None)
    for thing in (cloth, mirrored, empty):
        link(thing)
    cloth.parent, cloth.location, cloth.rotation_euler = empty, (0.1, -0.2, 1.0), (0.3, 0.1, -0.4)
    cloth.scale = (1, 2, 1.5)  # below a uniform one, or `flatten` loses the shear
    cloth.shape_key_add(name="rest")
    key = cloth.shape_key_add(name="blown")
    for point in key.data:
        point.co.x += point.co.z**2
    for frame, x, turn, scale, blown in ((1, 0, 0, (1.5,) * 3, 0), (5, 1, 0.8, (0.9,) * 3, 1)):
        empty.location, empty.rotation_euler, empty.scale = (x, 0, 0.2), (0, turn, 0.1), scale
        for path in ("location", "rotation_euler", "scale"):
            empty.keyframe_insert(path, frame=frame)
        key.value = blown
        key.keyframe_insert("value", frame=frame)
    _add_body()


def _add_body() -> None:
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(0, 0, 0.5))
    body = bpy.context.object
    body.name = "body"
    bpy.ops.object.armature_add(location=(0, 0, 0.3))
    rig = bpy.context.object
    bone = rig.pose.bones[0]
    bone.rotation_mode = "XYZ"
    for frame, turn in ((1, 0.0), (5, 0.9)):
        bone.rotation_euler = (turn, 0, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)
    group = body.vertex_groups.new(name=bone.name)
    group.add(range(4, 8), 1.0, "REPLACE")
    group.add(range(4), 0.5, "REPLACE")
    body.parent = rig
    body.matrix_parent_inverse = rig.matrix_world.inverted()
    body.modifiers.new("bones", "ARMATURE").object = rig


def write_truth(path: Path) -> None:
    """`<name>` (T, N, 3) of every mesh; `quads` (F, 4), `uvs` (F, 4, 2) and `materials` (F,) of the tube."""
    placed: dict[str, list[np.ndarray]] = {}
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        for thing in bpy.context.scene.objects:
            if thing.type == "MESH":
                moved = thing.evaluated_get(graph)
                points = [moved.matrix_world @ vertex.co for vertex in moved.data.vertices]
                placed.setdefault(thing.name, []).append(np.array(points))
    mesh = bpy.data.objects["cloth"].data
    corners = np.array([list(polygon.loop_indices) for polygon in mesh.polygons])
    np.savez(
        path,
        quads=np.array([polygon.vertices for polygon in mesh.polygons]),
        uvs=np.array([loop.uv for loop in mesh.uv_layers[0].data])[corners],
        materials=np.array([polygon.material_index for polygon in mesh.polygons]),
        **{name: np.stack(frames) for name, frames in placed.items()},
    )


def main(out: Path) -> None:
    """Write the truth and every export."""
    build()
    write_truth(out / "truth.npz")
    abc: dict[str, dict[str, Any]] = {
        "plain": {"face_sets": True},
        "flat": {"flatten": True},
        "triangles": {"triangulate": True, "quad_method": "FIXED"},
        "centimetres": {"global_scale": 100.0},
        "cages": {"subdiv_schema": True},
        "instances": {"use_instancing": True, "packuv": True, "face_sets": True},
    }
    for name, options in abc.items():
        frames = {"start": FRAMES[0], "end": FRAMES[-1], "as_background_job": False}
        bpy.ops.wm.alembic_export(filepath=str(out / f"{name}.abc"), **frames, **options)
    usd: dict[str, dict[str, Any]] = {
        "plain.usdc": {},
        "text.usda": {"export_subdivision": "TESSELLATE"},
        "packed.usdz": {},
        "y_up.usdc": {
            "convert_orientation": True,
            "export_global_forward_selection": "NEGATIVE_Z",
            "export_global_up_selection": "Y",
        },
        "centimetres.usd": {"convert_scene_units": "CENTIMETERS"},
        "points.usdc": {"export_armatures": False, "export_shapekeys": False},
        "merged.usdc": {"merge_parent_xform": True, "xform_op_mode": "MAT"},
        "triangles.usdc": {"triangulate_meshes": True, "quad_method": "FIXED"},
    }
    for name, options in usd.items():
        bpy.ops.wm.usd_export(filepath=str(out / name), export_animation=True, **options)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
