"""Spatio-temporal edge difference: how differently two moving meshes stretch, in space and in time.

After Váša and Skala, "A Perception Correlated Comparison Method for Dynamic Meshes", TVCG 17(2), 2011.
Absolute positions hardly matter to the eye, but neighbouring edges that change their lengths differently do,
and so does shaking. The definition as computed here, with lengths l of the true mesh and l' of the other:

- spatial part: the relative edge difference is e = (l' − l) / l. Around each vertex and in each frame, its
  standard deviation over the edges whose ends are both within `distance` edges of the vertex, weighted by l.
  Then the mean over vertices and frames.
- temporal part: a temporal edge joins a vertex with itself one frame later; its length is √(|Δp|² + dt²)
  with p divided by the mean diagonal of the true frames' bounding boxes. The difference of its length to the
  true one is divided by the true lengths' mean over `window` temporal edges about it. Then the mean over
  vertices and edges.
- STED = √(spatial² + c² temporal²).

The publication fits its parameters to subjective scores; the values used here are the defaults of
`imgtransfer.evaluation.config.StedConfig`, and numbers are comparable only between methods measured with the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.ndimage import uniform_filter1d

from imgtransfer.evaluation.config import StedConfig
from render.mesh.measures import edge_lengths

_DEFAULTS = StedConfig()


@dataclass(frozen=True)
class Sted:
    """The measure and what it is made of; numbers without unit, 0 for equal meshes.

    Args:
        whole: √(spatial² + c² temporal²).
        spatial, temporal: its parts, the temporal one not yet times c.
    """

    whole: float
    spatial: float
    temporal: float


def sted(predicted: np.ndarray, truth: np.ndarray, edges: np.ndarray, config: StedConfig = _DEFAULTS) -> Sted:
    """The measure and its parts.

    Args:
        predicted: (T, N, 3).
        truth: (T, N, 3), same unit.
        edges: (E, 2) int, every undirected edge once.
        config: its parameters.
    """
    spatial = sted_spatial(predicted, truth, edges, distance=config.distance)
    temporal = sted_temporal(predicted, truth, window=config.window, frame_step=config.frame_step)
    return Sted(float(np.hypot(spatial, config.temporal_weight * temporal)), spatial, temporal)


def sted_spatial(
    predicted: np.ndarray, truth: np.ndarray, edges: np.ndarray, *, distance: int = _DEFAULTS.distance
) -> float:
    """The spatial part; arguments as for `sted`. Edges without a true length do not count."""
    near = _edges_near_vertices(edges, truth.shape[1], distance)
    per_frame = []
    for frame_predicted, frame_truth in zip(predicted, truth, strict=True):
        length = edge_lengths(frame_truth.astype(np.float64), edges)
        known = length > 0
        change = np.zeros_like(length)
        change[known] = edge_lengths(frame_predicted.astype(np.float64), edges)[known] / length[known] - 1
        # A shift alters no deviation, but saves digits.
        change -= change[known].mean() if known.any() else 0.0
        total = near @ length
        used = total > 0
        mean = (near @ (length * change))[used] / total[used]
        variance = (near @ (length * change**2))[used] / total[used] - mean**2
        per_frame.append(np.sqrt(np.maximum(variance, 0)).mean() if used.any() else 0.0)
    return float(np.mean(per_frame))


def sted_temporal(
    predicted: np.ndarray,
    truth: np.ndarray,
    *,
    window: int = _DEFAULTS.window,
    frame_step: float = _DEFAULTS.frame_step,
) -> float:
    """The temporal part; arguments as for `sted`. 0 for a single frame."""
    if len(truth) < 2:
        return 0.0
    diagonal = np.linalg.norm(np.ptp(truth.astype(np.float64), axis=1), axis=-1).mean()
    true, other = (_temporal_lengths(points, diagonal, frame_step) for points in (truth, predicted))
    return float((np.abs(other - true) / _moving_mean(true, window)).mean())


def _temporal_lengths(points: np.ndarray, diagonal: float, frame_step: float) -> np.ndarray:
    """(T, N, 3) -> (T − 1, N)."""
    steps = np.diff(points.astype(np.float64), axis=0) / diagonal
    return np.sqrt((steps**2).sum(-1) + frame_step**2)


def _moving_mean(values: np.ndarray, window: int) -> np.ndarray:
    """Centred mean along the first axis over `window` entries, fewer at the ends."""
    total = uniform_filter1d(values, window, axis=0, mode="constant")
    inside = uniform_filter1d(np.ones(len(values)), window, mode="constant")
    return total / inside[:, None]


def _edges_near_vertices(edges: np.ndarray, n_vertices: int, distance: int) -> sparse.csr_matrix:
    """(N, E) of 0 and 1: whether both ends of the edge are within `distance` edges of the vertex."""
    ones = np.ones(len(edges))
    joined = sparse.coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices))
    step = ((joined + joined.T + sparse.identity(n_vertices)) > 0).astype(np.float64).tocsr()
    reach = step
    for _ in range(distance - 1):
        reach = ((reach @ step) > 0).astype(np.float64)
    return (reach.tocsc()[:, edges[:, 0]].multiply(reach.tocsc()[:, edges[:, 1]])).tocsr()
