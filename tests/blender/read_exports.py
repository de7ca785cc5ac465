"""Run by Blender's own Python (`bpy`): opens every file that it is given and says what Blender made of it.

    python read_exports.py OUT FILE...

OUT/NAME.npz for each FILE: `frames` (the scene's first and last), `fps`, `objects` (names), and for each mesh object at
FRAMES its vertices in world coordinates as Blender has them (metres, z up), its triangles, its texture coordinates by
corner, and the material of each triangle; `images` are the widths and heights of what was loaded. Point caches come in
as an artist brings them in: the OBJ, then a Mesh Cache.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

FRAMES = (0, 1, 2, 4, 5)


def open_file(path: Path) -> None:
    """Import a file into an empty scene of 30 frames a second."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 30
    ending = path.suffix
    if ending == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    elif ending == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(path), set_frame_range=True, as_background_job=False)
    elif ending.startswith(".usd"):
        bpy.ops.wm.usd_import(filepath=str(path), set_frame_range=True)
    elif ending == ".obj":
        bpy.ops.wm.obj_import(filepath=str(path))
    elif ending == ".ply":
        bpy.ops.wm.ply_import(filepath=str(path))
    else:
        for cache in sorted(path.parent.glob(f"*{ending}")):
            bpy.ops.wm.obj_import(filepath=str(cache.with_suffix(".obj")))
            modifier = bpy.context.selected_objects[0].modifiers.new("cache", "MESH_CACHE")
            modifier.cache_format, modifier.filepath = ending[1:].upper(), str(cache)
            modifier.frame_start = 0


def main(out: Path, files: list[Path]) -> None:
    for path in files:
        open_file(path)
        scene, found = bpy.context.scene, {}
        meshes = [thing for thing in scene.objects if thing.type == "MESH"]
        found["objects"] = np.array(sorted(thing.name for thing in meshes))
        found["images"] = np.array([tuple(image.size) for image in bpy.data.images]).reshape(-1, 2)
        found["range"] = np.array([scene.frame_start, scene.frame_end])
        found["fps"] = np.float64(scene.render.fps / scene.render.fps_base)
        for frame in FRAMES:
            scene.frame_set(frame)
            graph = bpy.context.evaluated_depsgraph_get()
            for thing in meshes:
                seen = thing.evaluated_get(graph)
                mesh = seen.to_mesh()
                vertices = np.empty(3 * len(mesh.vertices), np.float32)
                mesh.vertices.foreach_get("co", vertices)
                world = np.array(seen.matrix_world)
                placed = vertices.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
                found[f"{thing.name}_{frame}"] = placed.astype(np.float32)
                seen.to_mesh_clear()
        for thing in meshes:
            mesh = thing.data
            corners = np.empty(len(mesh.loops), np.int32)
            mesh.loops.foreach_get("vertex_index", corners)
            found[f"{thing.name}_faces"] = corners.reshape(-1, 3)
            if mesh.uv_layers:
                uvs = np.empty(2 * len(mesh.loops), np.float32)
                mesh.uv_layers[0].data.foreach_get("uv", uvs)
                found[f"{thing.name}_uvs"] = uvs.reshape(-1, 3, 2)
            names = [slot.material.name if slot.material else "" for slot in thing.material_slots]
            used = [names[polygon.material_index] if names else "" for polygon in mesh.polygons]
            found[f"{thing.name}_materials"] = np.array(used)
        np.savez(out / f"{path.name}.npz", **found)


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
