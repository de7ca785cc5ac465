"""Predicted vertices in files, of this program or another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from render import InputError
from render.files.npz import open_npz
from render.mesh.mesh import check_finite


def predicted_vertices(file: Path) -> np.ndarray:
    """The garment vertices (T, N, 3) of a clip npz, or of any npz that has them.

    Raises:
        InputError: no npz, or none with finite garment_vertices of that shape.
    """
    with open_npz(file, "a clip npz with predicted garment_vertices") as npz:
        shape = npz.shape("garment_vertices") if "garment_vertices" in npz else ()
        if len(shape) != 3 or shape[2] != 3:
            raise InputError(
                f"{file}: predicts nothing; garment_vertices of shape (frames, vertices, 3) are wanted"
            )
        vertices: np.ndarray = npz.read("garment_vertices")
    check_finite(vertices, f"{file}: garment_vertices")
    return vertices
