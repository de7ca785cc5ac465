"""Where a cloth passes through itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.warp_start import warp_module
from render.mesh.mesh import Mesh


def crossings(mesh: Mesh, vertices: np.ndarray) -> np.ndarray:
    """(T, E) bool: which of `mesh.edges` pass through a triangle that they share no vertex with.

    Args:
        mesh: gives edges and faces. vertices: (T, N, 3) metres.
    """
    from imgtransfer.simulation.cloth.contact_kernels import find_crossings  # noqa: PLC0415 (heavy)

    warp, device = warp_module(), "cpu"
    faces = mesh.faces.astype(np.int32)
    points = warp.zeros(len(mesh.vertices), dtype=warp.vec3, device=device)
    corners: Any = warp.array(faces, dtype=warp.vec3i, device=device)
    edges: Any = warp.array(mesh.edges.astype(np.int32), dtype=warp.vec2i, device=device)
    crossing = warp.zeros(len(mesh.edges), dtype=int, device=device)
    cloth = None
    marks = np.zeros((len(vertices), len(mesh.edges)), bool)
    for frame, positions in enumerate(vertices):
        points.assign(positions.astype(np.float32))
        if cloth is None:
            cloth = warp.Mesh(points=points, indices=warp.array(faces.ravel(), dtype=int, device=device))
        cloth.refit()
        given = [edges, corners, cloth.id, points, crossing]
        warp.launch(find_crossings, dim=len(mesh.edges), inputs=given, device=device)
        marks[frame] = crossing.numpy() > 0
    return marks
