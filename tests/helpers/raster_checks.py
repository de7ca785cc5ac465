"""What the raster's tests share: how near a pixel's centre is to an edge, a camera amid the faces, ray casting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from render import Camera, Mesh
from render.cameras import perspective
from render.raster.screen import screen_faces


def distance_to_edges(mesh: Mesh, camera: Camera) -> np.ndarray:
    """(H, W): pixels from each pixel centre to the nearest edge of any face, up to 1 (inf beyond)."""
    height, width = camera.size
    nearest = np.full((height, width), np.inf)
    for corners in screen_faces(mesh, camera).corners:
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            low = np.clip(np.floor(np.minimum(a, b)) - 1, 0, (width, height)).astype(int)
            high = np.clip(np.ceil(np.maximum(a, b)) + 1, 0, (width, height)).astype(int)
            x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
            offset = np.stack([x, y], -1) - a
            along = np.clip(offset @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
            distance = np.linalg.norm(offset - along[..., None] * (b - a), axis=-1)
            window = nearest[low[1] : high[1], low[0] : high[0]]
            np.minimum(window, distance, out=window)
    return nearest


def camera_at(z: float, *, near: float, size: tuple[int, int] = (96, 128)) -> Camera:
    """On the z axis at height z, looking along -z, about 77 degrees over the image's height."""
    view = np.eye(4)
    view[2, 3] = -z
    tangent = np.array([0.8 * size[1] / size[0], 0.8])
    return Camera("amid", view, perspective(tangent, near=near, far=100), size)


def peeled(camera: Camera, layers: int) -> list[Camera]:
    """The camera's first layers."""
    return [replace(camera, name=f"{camera.name}/{k}", layer=k) for k in range(layers)]


def cast_rays(mesh: Mesh, camera: Camera, layers: int) -> tuple[np.ndarray, np.ndarray]:
    """What Embree finds along the ray through each pixel's centre from the near plane on.

    Returns:
        (L, H, W) the faces met, -1 where there is none, and their depths (L, H, W) in metres, inf there.
    """
    height, width = camera.size
    row, column = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    device = np.stack([(column + 0.5) * 2 / width - 1, 1 - (row + 0.5) * 2 / height], -1).reshape(-1, 2)
    slopes = device / [camera.projection[0, 0], camera.projection[1, 1]]
    rotation, eye = camera.view[:3, :3], np.linalg.inv(camera.view)[:3, 3]
    direction = np.concatenate([slopes, -np.ones((height * width, 1))], axis=1) @ rotation
    embree = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    face, ray, place = embree.intersects_id(
        eye + camera.near * direction,
        direction,
        multiple_hits=True,
        max_hits=layers + 4,
        return_locations=True,
    )
    distance = (eye - place) @ rotation[2]
    ids, depth = np.full((layers, height * width), -1), np.full((layers, height * width), np.inf)
    order = np.lexsort((distance, ray))
    face, ray, distance = face[order], ray[order], distance[order]
    first = np.flatnonzero(np.diff(ray, prepend=-1))
    rank = np.arange(len(ray)) - np.repeat(first, np.diff(first, append=len(ray)))
    kept = rank < layers
    ids[rank[kept], ray[kept]], depth[rank[kept], ray[kept]] = face[kept], distance[kept]
    return ids.reshape(layers, height, width), depth.reshape(layers, height, width)
