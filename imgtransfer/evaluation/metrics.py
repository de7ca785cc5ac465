"""What a predicted clip is judged by."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import torch
from scipy.spatial import cKDTree

from fusion import BodySdf
from fusion.obstacles import body_crossing_fractions, self_crossing_fractions
from imgtransfer.evaluation.config import EvaluateConfig
from imgtransfer.evaluation.sted import sted
from render import InputError, Mesh
from render.threads import one_blas_thread

METRICS = (
    "rmse_mm",
    "rms_mm",
    "hausdorff_mm",
    "sted",
    "sted_spatial",
    "sted_temporal",
    "penetration_percent",
    "crossing_percent",
    "self_crossing_percent",
)


@one_blas_thread()
def evaluate_clip(
    predicted: np.ndarray,
    truth: np.ndarray,
    faces: np.ndarray,
    body_vertices: np.ndarray,
    body_faces: np.ndarray,
    *,
    config: EvaluateConfig | None = None,
) -> dict[str, float]:
    """All metrics of one clip (section 4.1 of the paper, penetration and crossings).

    Args:
        predicted: (T, N, 3) garment vertices, metres.
        truth: (T, N, 3), metres.
        faces: (F, 3) int, of the garment.
        body_vertices: (T, B, 3), metres.
        body_faces: (G, 3) int.
        config: parameters of the metrics; the defaults if None.

    Returns:
        rmse_mm: mean Euclidean distance over frames and vertices, which the field calls RMSE.
        rms_mm: the root of the mean squared distance.
        hausdorff_mm: mean over frames of the two-sided Hausdorff distance between the vertex sets.
        sted, sted_spatial, sted_temporal: spatio-temporal edge difference, see `imgtransfer.evaluation.sted`, and its
            parts, the temporal one not yet weighted; no unit.
        penetration_percent: per cent of the garment vertices with negative distance to the body.
        crossing_percent: garment edges that pass through the body's faces and body edges that pass through the
            garment's, in per cent of the garment's edges, mean over frames.
        self_crossing_percent: per cent of the garment edges that pass through its own faces.

    Raises:
        InputError: shapes that differ.
    """
    if predicted.shape != truth.shape:
        raise InputError(
            f"predicted vertices have shape {predicted.shape}, the truth {truth.shape}: not the same clip"
        )
    if len(body_vertices) != len(truth):
        raise InputError(f"the garment has {len(truth)} frames, the body {len(body_vertices)}")
    distance = np.linalg.norm(predicted.astype(np.float64) - truth.astype(np.float64), axis=-1)
    edge_difference = sted(
        predicted, truth, Mesh(truth[0], faces, "garment").edges, (config or EvaluateConfig()).sted
    )
    values = (
        1e3 * distance.mean(),
        1e3 * np.sqrt((distance**2).mean()),
        1e3 * np.mean([vertex_hausdorff(a, b) for a, b in zip(predicted, truth, strict=True)]),
        edge_difference.whole,
        edge_difference.spatial,
        edge_difference.temporal,
        penetration_percent(predicted, body_vertices, body_faces),
        crossing_percent(predicted, faces, body_vertices, body_faces),
        self_crossing_percent(predicted, faces),
    )
    return {name: float(value) for name, value in zip(METRICS, values, strict=True)}


def vertex_hausdorff(a: np.ndarray, b: np.ndarray) -> float:
    """Two-sided Hausdorff distance between point sets (N, 3) and (M, 3), in their unit."""
    return float(max(cKDTree(b).query(a)[0].max(), cKDTree(a).query(b)[0].max()))


def penetration_percent(vertices: np.ndarray, body_vertices: np.ndarray, body_faces: np.ndarray) -> float:
    """Per cent of the vertices (T, N, 3) with negative distance to the body (T, B, 3) of their frame."""
    body = BodySdf(body_faces, body_vertices.shape[1])
    inside = 0
    for points, pose in zip(vertices, body_vertices, strict=True):
        body.update(pose)
        nearest = body.query(torch.from_numpy(np.ascontiguousarray(points, np.float32)))
        inside += int((nearest.distance < 0).sum())
    return 100.0 * inside / (vertices.shape[0] * vertices.shape[1])


def crossing_percent(
    vertices: np.ndarray, faces: np.ndarray, body_vertices: np.ndarray, body_faces: np.ndarray
) -> float:
    """Edges that pass through a face of the other, of a garment (T, N, 3) and the body (T, B, 3) of its frames.

    Returns:
        Per cent of the garment's edges, mean over frames.
    """
    return 100.0 * float(body_crossing_fractions(vertices, faces, body_vertices, body_faces).mean())


def self_crossing_percent(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Per cent of the edges of a garment (T, N, 3) that pass through its own faces, mean over frames."""
    return 100.0 * float(self_crossing_fractions(vertices, faces).mean())


def mean_over_frames(metrics: Iterable[tuple[Mapping[str, float], int]]) -> dict[str, float]:
    """Mean of the metrics of several clips, weighted by their numbers of frames.

    Args:
        metrics: pairs of what `evaluate_clip` returned and the clip's number of frames.
    """
    pairs = list(metrics)
    total = sum(frames for _, frames in pairs)
    return {name: sum(values[name] * frames for values, frames in pairs) / total for name in METRICS}
