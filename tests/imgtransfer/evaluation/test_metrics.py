"""Metrics on cases whose answers are known."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.evaluation.config import EvaluateConfig, StedConfig
from imgtransfer.evaluation.metrics import (
    METRICS,
    crossing_percent,
    evaluate_clip,
    mean_over_frames,
    self_crossing_percent,
    vertex_hausdorff,
)
from imgtransfer.evaluation.sted import Sted, sted, sted_spatial, sted_temporal
from imgtransfer.evaluation.table import metrics_json, metrics_table
from render import InputError, Mesh

TRIANGLE = np.array([[[0, 0, 0], [3, 0, 0], [0, 4, 0]]], np.float64)  # edges 3, 4, 5
TRIANGLE_EDGES = np.array([[0, 1], [0, 2], [1, 2]])


def sphere(radius: float) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int64)


def measure(predicted: np.ndarray, clip: Clip) -> dict[str, float]:
    return evaluate_clip(
        predicted, clip.garment.vertices, clip.template.faces, clip.body.vertices, clip.body.faces
    )


def test_equal_meshes_have_no_error(tube_clip: Clip) -> None:
    assert measure(tube_clip.garment.vertices, tube_clip) == dict.fromkeys(METRICS, 0.0)


def test_a_translated_mesh(tube_clip: Clip) -> None:
    moved = tube_clip.garment.vertices.astype(np.float64) + np.array([0.003, 0.0, 0.004])
    found = measure(moved, tube_clip)
    assert found["rmse_mm"] == pytest.approx(5.0)
    assert found["rms_mm"] == pytest.approx(5.0)
    assert 0 < found["hausdorff_mm"] <= 5.0 + 1e-9
    assert found["sted"] == pytest.approx(0.0, abs=1e-9)
    assert found["penetration_percent"] == 0.0  # the gap is 40 mm


def test_mean_distance_and_root_mean_square_differ() -> None:
    truth = TRIANGLE.copy()
    predicted = truth + np.array([[0, 0, 3e-3], [0, 0, 4e-3], [0, 0, 0]])
    body, faces = sphere(0.1)
    found = evaluate_clip(predicted, truth, np.array([[0, 1, 2]]), body[None] + 20, faces)
    assert found["rmse_mm"] == pytest.approx(7 / 3)
    assert found["rms_mm"] == pytest.approx(np.sqrt(25 / 3))
    assert found["hausdorff_mm"] == pytest.approx(4.0)


def test_a_sphere_inside_a_sphere() -> None:
    inner, faces = sphere(0.3)
    outer, _ = sphere(0.5)
    found = evaluate_clip(inner[None], outer[None], faces, outer[None], faces)
    assert found["penetration_percent"] == 100.0
    assert found["hausdorff_mm"] == pytest.approx(200.0, rel=1e-5)
    assert found["rmse_mm"] == pytest.approx(200.0, rel=1e-5)
    assert found["sted"] == pytest.approx(0.0, abs=1e-6)  # all edges shrink by the same share
    outside = evaluate_clip(outer[None], outer[None], faces, inner[None], faces)
    assert outside["penetration_percent"] == 0.0


def test_a_knee_that_comes_through_one_cloth_face_crosses_though_no_vertex_is_inside() -> None:
    """A tetrahedron's tip through the left of two faces: three body edges, and no garment edge or vertex."""
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    knee = np.array([[-0.5, 0.2, 0.5], [-0.6, -1, 0.5], [-0.5, -1, 0.6], [-0.4, -1, 0.4]], np.float32)
    knee_faces = np.array([[1, 3, 2], [0, 1, 2], [0, 2, 3], [0, 3, 1]])
    apart = square + np.float32([0, 1, 0])
    frames, body = np.stack([square, apart]), np.stack([knee] * 2)
    values = evaluate_clip(frames, frames, faces, body, knee_faces)
    assert values["penetration_percent"] == 0
    assert values["crossing_percent"] == pytest.approx(100 * 3 / 5 / 2)  # of five edges, in one of two frames
    assert values["self_crossing_percent"] == 0


def test_edges_of_both_count_over_those_of_the_garment() -> None:
    """A garment edge through a body face, and a body edge through a garment face, of five garment edges."""
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    # An upright triangle that enters the square from beside: its lower side stays under it, one of its others crosses.
    fin = np.array([[0.5, -0.5, -0.5], [0.5, 0.5, -0.5], [5, 0.1, -0.5]], np.float32)
    values = crossing_percent(square[None], faces, fin[None], np.array([[0, 1, 2]]))
    assert values == pytest.approx(100 * 2 / 5)


def test_a_body_that_fills_an_open_garment_and_its_openings_does_not_cross(tube_clip: Clip) -> None:
    body, faces = tube_clip.body, tube_clip.template.faces
    assert np.ptp(body.vertices[0, :, 1]) > np.ptp(tube_clip.garment.vertices[0, :, 1])  # through both ends
    assert crossing_percent(tube_clip.garment.vertices, faces, body.vertices, body.faces) == 0
    wide = body.vertices.copy()
    wide[..., 0] *= 2
    assert crossing_percent(tube_clip.garment.vertices, faces, wide, body.faces) > 1


def test_cloth_through_itself_counts_edges_of_its_own() -> None:
    flat, upright = TRIANGLE[0] / 4, np.array([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1]])
    vertices, faces = np.concatenate([flat, upright])[None], np.array([[0, 1, 2], [3, 4, 5]])
    assert self_crossing_percent(vertices, faces) == pytest.approx(100 * 2 / 6)


def test_hausdorff_is_two_sided() -> None:
    a, b = np.zeros((1, 3)), np.array([[0.0, 0, 0], [2.0, 0, 0]])
    assert vertex_hausdorff(a, b) == vertex_hausdorff(b, a) == 2.0


def test_spatial_sted_of_a_uniformly_scaled_mesh_is_zero() -> None:
    assert sted_spatial(1.7 * TRIANGLE, TRIANGLE, TRIANGLE_EDGES) == pytest.approx(0.0, abs=1e-9)


def test_spatial_sted_of_a_mesh_scaled_along_one_axis() -> None:
    scaled = TRIANGLE * [2, 1, 1]  # edges 6, 4, √52: relative changes 1, 0, √52/5 − 1, weights 3, 4, 5
    change = np.array([1, 0, np.sqrt(52) / 5 - 1])
    mean = (3 * change[0] + 4 * change[1] + 5 * change[2]) / 12
    by_hand = np.sqrt((3 * (change[0] - mean) ** 2 + 4 * mean**2 + 5 * (change[2] - mean) ** 2) / 12)
    assert sted_spatial(scaled, TRIANGLE, TRIANGLE_EDGES) == pytest.approx(by_hand)


def test_temporal_sted_of_a_point_that_shakes() -> None:
    truth = np.array([[[0, 0, 0], [1.0, 0, 0]]] * 3)  # stands still, diagonal 1: true lengths are dt
    shaken = truth.copy()
    shaken[1, 0, 1] = 0.3  # two of four temporal edges get the length √(0.09 + dt²)
    dt = 0.4
    assert sted_temporal(shaken, truth, frame_step=dt) == pytest.approx((0.5 - 0.4) / 0.4 * 2 / 4)


def test_the_temporal_window_averages_the_true_lengths() -> None:
    truth = np.zeros((4, 2, 3))
    truth[:, 1, 0] = 1.0  # keeps the diagonal at 1
    truth[2:, :, 2] = 0.3  # the second of three temporal edges is long
    predicted = truth + 0.0
    predicted[3, :, 2] = 0.6  # as is the third of the prediction, where the truth stands still
    lengths = np.array([0.4, 0.5, 0.4])  # dt = 0.4
    by_hand = (0.5 - 0.4) / lengths[1:].mean() / 3
    assert sted_temporal(predicted, truth, window=3, frame_step=0.4) == pytest.approx(by_hand)


def test_sted_combines_both_parts(tube_clip: Clip) -> None:
    truth = tube_clip.garment.vertices
    edges = Mesh(truth[0], tube_clip.template.faces).edges
    predicted = truth + np.random.default_rng(0).normal(0, 2e-3, truth.shape)
    spatial, temporal = sted_spatial(predicted, truth, edges), sted_temporal(predicted, truth)
    assert spatial > 0.01
    assert temporal > 0.01
    assert sted(predicted, truth, edges) == Sted(np.hypot(spatial, 0.136 * temporal), spatial, temporal)
    measured = measure(predicted, tube_clip)
    assert (measured["sted_spatial"], measured["sted_temporal"]) == (spatial, temporal)
    config = StedConfig(distance=2, window=3, temporal_weight=2.0, frame_step=0.1)
    spatial = sted_spatial(predicted, truth, edges, distance=2)
    temporal = sted_temporal(predicted, truth, window=3, frame_step=0.1)
    assert sted(predicted, truth, edges, config) == Sted(np.hypot(spatial, 2 * temporal), spatial, temporal)


@pytest.mark.parametrize("distance", [1, 2])
def test_spatial_sted_equals_a_plain_loop(tube_clip: Clip, distance: int) -> None:
    truth = tube_clip.garment.vertices[:2].astype(np.float64)
    predicted = truth + np.random.default_rng(1).normal(0, 2e-3, truth.shape)
    edges = Mesh(truth[0], tube_clip.template.faces).edges
    neighbours = {v: {v} for v in range(truth.shape[1])}
    for a, b in edges:
        neighbours[a].add(b)
        neighbours[b].add(a)
    deviations = []
    for p, t in zip(predicted, truth, strict=True):
        for v in range(truth.shape[1]):
            reach = {v}
            for _ in range(distance):
                reach = {w for u in reach for w in neighbours[u]}
            near = np.array([e for e in edges if e[0] in reach and e[1] in reach])
            length = np.linalg.norm(t[near[:, 0]] - t[near[:, 1]], axis=1)
            change = np.linalg.norm(p[near[:, 0]] - p[near[:, 1]], axis=1) / length - 1
            mean = np.average(change, weights=length)
            deviations.append(np.sqrt(np.average((change - mean) ** 2, weights=length)))
    assert sted_spatial(predicted, truth, edges, distance=distance) == pytest.approx(np.mean(deviations))


def test_a_rigidly_moved_prediction_has_no_sted_and_moving_both_changes_nothing(tube_clip: Clip) -> None:
    turn, shift = Rotation.from_rotvec([0, np.pi / 2, 0]), np.array([1.0, 2.0, 3.0])

    def moved(points: np.ndarray) -> np.ndarray:
        return turn.apply(points.astype(np.float64).reshape(-1, 3)).reshape(points.shape) + shift

    truth = tube_clip.garment.vertices.astype(np.float64)
    edges = Mesh(truth[0], tube_clip.template.faces).edges
    assert sted(moved(truth), truth, edges).whole == pytest.approx(0.0, abs=1e-9)
    predicted = truth + np.random.default_rng(2).normal(0, 2e-3, truth.shape)
    still = measure(predicted, tube_clip)
    both = evaluate_clip(
        moved(predicted),
        moved(truth),
        tube_clip.template.faces,
        moved(tube_clip.body.vertices),
        tube_clip.body.faces,
    )
    assert both == pytest.approx(still, rel=1e-9)


def test_edges_of_no_length_and_single_frames_are_no_trouble() -> None:
    folded = np.zeros((1, 3, 3))
    assert sted(folded, folded, TRIANGLE_EDGES) == Sted(0.0, 0.0, 0.0)
    half = TRIANGLE.copy()
    half[:, 2] = half[:, 1]
    assert np.isfinite(sted(TRIANGLE, half, TRIANGLE_EDGES).whole)


def test_clips_that_do_not_belong_together_are_refused(tube_clip: Clip) -> None:
    with pytest.raises(InputError, match="not the same clip"):
        measure(tube_clip.garment.vertices[:3], tube_clip)


def test_the_overall_mean_counts_frames() -> None:
    a, b = dict.fromkeys(METRICS, 1.0), dict.fromkeys(METRICS, 4.0)
    assert mean_over_frames([(a, 20), (b, 10)]) == pytest.approx(dict.fromkeys(METRICS, 2.0))


def test_table_and_json() -> None:
    values = dict(zip(METRICS, (12.346, 13.0, 40.0, 0.0567, 0.0123, 0.407, 0.25, 0.5, 0.125), strict=True))
    table = metrics_table({"tube/bend": values, "overall": values})
    assert "12.35" in table
    assert "0.0567" in table
    assert len(table.splitlines()) == 4
    assert json.loads(metrics_json({"tube/bend": values}, values, EvaluateConfig())) == {
        "clips": {"tube/bend": values},
        "overall": values,
        "config": EvaluateConfig().model_dump(),
    }
