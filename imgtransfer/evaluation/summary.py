"""Facts about a clip that show at a glance whether it can be used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.evaluation.metrics import crossing_percent, penetration_percent, self_crossing_percent
from render import InputError, Mesh
from render.mesh.measures import edge_lengths

SAMPLED_FRAMES = 12


@dataclass(frozen=True)
class ClipSummary:
    """What `imgtransfer inspect` prints of one clip.

    Args:
        name: the clip's name. frames, fps: its length and rate.
        garment_vertices, garment_faces, body_vertices, body_faces: sizes of the meshes.
        strain: median and 99th percentile of |l / l₀ − 1| over edges of the garment, l₀ being the template's,
            per cent; None without a garment.
        penetration: fraction of garment vertices inside the body, per cent; None without a garment.
        crossing, self_crossing: `crossing_percent` and `self_crossing_percent` of the metrics; None without a garment.
        sampled: frames that the last four were measured on, spread evenly.
    """

    name: str
    frames: int
    fps: float
    garment_vertices: int
    garment_faces: int
    body_vertices: int
    body_faces: int
    strain: tuple[float, float] | None
    penetration: float | None
    crossing: float | None
    self_crossing: float | None
    sampled: int


def summarise(clip: Clip) -> ClipSummary:
    """Measure a clip on at most `SAMPLED_FRAMES` of its frames.

    Raises:
        InputError: a template all of whose edges have length 0.
    """
    chosen = np.unique(np.linspace(0, clip.n_frames - 1, SAMPLED_FRAMES).round().astype(int))
    strain = penetration = crossing = self_crossing = None
    if clip.garment is not None:
        garment = clip.garment.vertices[chosen]
        stretched = np.abs(edge_strain(garment, clip.template.vertices, clip.template.faces))
        strain = 100 * float(np.median(stretched)), 100 * float(np.percentile(stretched, 99))
        body, faces = clip.body.vertices[chosen], clip.template.faces
        penetration = penetration_percent(garment, body, clip.body.faces)
        crossing = crossing_percent(garment, faces, body, clip.body.faces)
        self_crossing = self_crossing_percent(garment, faces)
    return ClipSummary(
        name=clip.name,
        frames=clip.n_frames,
        fps=clip.fps,
        garment_vertices=len(clip.template.vertices),
        garment_faces=len(clip.template.faces),
        body_vertices=len(clip.body.rest),
        body_faces=len(clip.body.faces),
        strain=strain,
        penetration=penetration,
        crossing=crossing,
        self_crossing=self_crossing,
        sampled=len(chosen),
    )


def edge_strain(vertices: np.ndarray, template: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """l / l₀ − 1 of every edge: vertices (T, N, 3) and template (N, 3) -> (T, E) float64.

    Edges of the template without length are left out.

    Raises:
        InputError: no edge of the template has a length.
    """
    edges = Mesh(template, faces, "template").edges
    rest = edge_lengths(template.astype(np.float64), edges)
    if not rest.any():
        raise InputError("template: all its edges have length 0")
    return edge_lengths(vertices.astype(np.float64), edges)[..., rest > 0] / rest[rest > 0] - 1
