"""Numbers on a garment as colours: its distance to the truth, how its edges are stretched."""

from __future__ import annotations

from typing import Literal

import numpy as np

from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh
from render.pictures import heat_colours

Colours = Literal["cloth", "error", "strain"]
UNITS: dict[Colours, str] = {"error": "mm", "strain": "%"}
LEVELS = 16  # of colour: the page's meshes have one colour each
_PERCENTILE = 99  # of the values, that the last colour stands for
_STEPS = (1, 1.5, 2, 3, 4, 5, 6, 8, 10)  # of round numbers, in each power of ten

#: (LEVELS, 3) uint8, of `heat_colours`.
LEVEL_COLOURS = heat_colours((np.arange(LEVELS) + 0.5) / LEVELS)


def error_mm(vertices: np.ndarray, truth: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F,) mean distance of each face's corners to where they are in truth, millimetres.

    Args:
        vertices, truth: (N, 3) metres. faces: (F, 3).
    """
    return 1000 * np.linalg.norm(vertices.astype(np.float64) - truth, axis=-1)[faces].mean(axis=1)


class Strain:
    """How much the edges of each face are longer or shorter than at rest.

    Args:
        rest: the garment at rest.
    """

    def __init__(self, rest: Mesh) -> None:
        self._edges = rest.edges
        self._rest = np.maximum(edge_lengths(rest.vertices, self._edges), 1e-9)
        numbers = {tuple(edge): number for number, edge in enumerate(np.sort(self._edges, axis=1).tolist())}
        corners = np.sort(np.stack([rest.faces, np.roll(rest.faces, -1, axis=1)], axis=-1), axis=-1)
        self._of_face = np.array(
            [[numbers[tuple(edge)] for edge in face] for face in corners.tolist()], np.int64
        ).reshape(-1, 3)

    def percent(self, vertices: np.ndarray) -> np.ndarray:
        """(F,) of the three edges of each face the largest change of length, per cent of the length at rest."""
        change = np.abs(edge_lengths(vertices, self._edges) / self._rest - 1)
        largest: np.ndarray = 100 * change[self._of_face].max(axis=1)
        return largest


def levels(values: np.ndarray, limit: float) -> np.ndarray:
    """(F,) int64 below `LEVELS`: 0 from 0 on, the last from `limit` on."""
    scaled = np.nan_to_num(values / limit * LEVELS, nan=0.0, posinf=LEVELS)
    return np.clip(np.floor(scaled), 0, LEVELS - 1).astype(np.int64)


def round_limit(values: np.ndarray) -> float:
    """A round number that nearly all of the values are below: what the last colour should stand for."""
    if not len(values) or not (top := float(np.percentile(values, _PERCENTILE))) > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(top))
    return float(next(step * power for step in (*_STEPS, 10.0) if step * power >= top * (1 - 1e-9)))
