"""Whether a garment has slipped from where it was put on, such as a wide neck over both shoulders."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.garments.cutting import border_loops
from render.mesh.mesh import Mesh


def slip(pattern: Mesh, vertices: np.ndarray, rest: np.ndarray, body: np.ndarray) -> float:
    """How far the garment's topmost opening has slipped over the body, metres, in the worst frame.

    Where a vertex lies on the body is told by the body's nearest vertex, and how far it has come by how far that one
    is, on the resting body, from the one that was nearest when the garment was put on. Of the opening's vertices the
    median counts: one bare shoulder is fashion, two are a fault. A closed surface has no opening and cannot slip.

    Args:
        pattern: the garment as it is put on the resting body. vertices: (T, N, 3) metres.
        rest: (B, 3) the resting body. body: (T, B, 3).
    """
    loops = border_loops(pattern.faces)
    if not loops:
        return 0.0
    top = max(loops, key=lambda loop: pattern.vertices[loop, 1].mean())
    begun = rest[cKDTree(rest).query(pattern.vertices[top])[1]]
    slipped = 0.0
    for cloth, skin in zip(vertices, body, strict=True):
        now = rest[cKDTree(skin).query(cloth[top])[1]]
        slipped = max(slipped, float(np.median(np.linalg.norm(now - begun, axis=-1))))
    return slipped
