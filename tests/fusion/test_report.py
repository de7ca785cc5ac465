"""Means over frames, gathered batch by batch, and the seconds of each stage."""

import threading
import time

import numpy as np
import pytest
import torch

from fusion import FusionConfig
from fusion.crossing_report import ClothAndBody, CrossingFractions, CrossingReport
from fusion.obstacles import body_crossing_fractions
from fusion.obstacles.cached import make_obstacle, pose
from fusion.report import Statistics, Stopwatch
from fusion.stages import BatchResult, SolverResult
from fusion.topology import Topology
from tests.helpers.fusion_examples import cylinder_body, inputs_of, tube

CONFIG = FusionConfig(weight_displacement=1.0)  # weights 1e4 of both terms of the first stage


def batch(edge=None, *, unseen, inside=None, crossing=None, itself=None):
    """A batch by its curve of the edge term (K, T) in cm² (the displacement term is 1 cm² all along)."""
    stages = {}
    if edge is not None:
        curve = torch.tensor(edge) * 1e-4
        history = {"edge_length_m2": curve, "displacement_m2": torch.full_like(curve, 1e-4)}
        steps = torch.full((curve.shape[1],), len(curve) - 1)
        stages["edge"] = SolverResult(torch.zeros(0), history, steps)
    vertices = np.zeros((len(unseen), 2, 3), np.float32)
    inside = None if inside is None else tuple(np.array(part) for part in inside)
    crossing = None if crossing is None else tuple(np.array(part) for part in crossing)
    fractions = CrossingFractions(crossing, np.zeros(len(unseen)) if itself is None else np.array(itself))
    return BatchResult(vertices, vertices, stages, np.array(unseen), inside, fractions)


def reported(*batches, config=CONFIG, history=True):
    statistics = Statistics(config)
    for one in batches:
        statistics.add(one)
    return statistics.report(history=history)


def test_means_by_hand():
    """Three frames in two batches: 8, 4 and 0 cm² at the start, 2, 4 and 0 at the end, after 1, 1 and 2 steps."""
    report = reported(
        batch([[8.0, 4.0], [2.0, 4.0]], unseen=[0.1, 0.3]), batch([[0.0], [3.0], [0.0]], unseen=[0.5])
    )
    assert report["frames"] == 3
    assert report["iterations"] == {"edge": pytest.approx(4 / 3)}
    assert report["unseen_percent"] == pytest.approx(30)
    assert report["terms"]["edge"]["start"]["edge_length_m2"] == pytest.approx(4e-4)
    assert report["terms"]["edge"]["end"]["edge_length_m2"] == pytest.approx(2e-4)
    assert report["total"]["edge"] == {"start": pytest.approx(5), "end": pytest.approx(3)}
    assert report["history"]["edge"]["total"] == pytest.approx([5, 1 + (2 + 4 + 3) / 3, 3])


def test_the_order_and_the_size_of_batches_do_not_matter():
    curves = np.random.default_rng(0).random((3, 5)).astype(np.float32)
    unseen = [0.0, 0.25, 0.5, 0.75, 1.0]
    inside = np.random.default_rng(1).random((2, 5))

    def cut(*ends):
        starts = (0, *ends[:-1])
        return [
            batch(curves[:, a:b], unseen=unseen[a:b], inside=inside[:, a:b])
            for a, b in zip(starts, ends, strict=True)
        ]

    want = reported(*cut(5))
    for parts in (cut(1, 2, 3, 4, 5), cut(2, 5)[::-1]):
        found = reported(*parts)
        assert found["total"]["edge"] == pytest.approx(want["total"]["edge"])
        assert found["penetration_percent"] == pytest.approx(want["penetration_percent"])
        assert found["unseen_percent"] == pytest.approx(50)


def test_penetration_is_told_before_and_after_the_clean_up():
    report = reported(
        batch(unseen=[0.0, 0.0], inside=([0.5, 0.3], [0.0, 0.1])), batch(unseen=[0.0], inside=([0.1], [0.2]))
    )
    assert report["penetration_percent"] == pytest.approx({"before_clearance": 30, "after": 10})


def test_crossings_are_told_before_and_after_the_clean_up():
    report = reported(
        batch(unseen=[0.0, 0.0], crossing=([0.5, 0.3], [0.0, 0.1]), itself=[0.25, 0.0]),
        batch(unseen=[0.0], crossing=([0.1], [0.2]), itself=[0.5]),
    )
    assert report["crossing_percent"] == pytest.approx({"before_clearance": 30, "after": 10})
    assert report["self_crossing_percent"] == pytest.approx(25)


def test_what_did_not_happen_is_not_reported():
    report = reported(batch(unseen=[0.0]), history=False)
    assert (report["terms"], report["total"], report["iterations"]) == ({}, {}, {})
    assert "penetration_percent" not in report
    assert "crossing_percent" not in report
    assert "history" not in report
    assert reported(batch(unseen=[0.0]))["history"] == {}


def test_numbers_are_plain():
    """A report goes into JSON and to other processes."""
    report = reported(batch([[1.0], [0.5]], unseen=[0.5], inside=([0.5], [0.0])))

    def leaves(value):
        if isinstance(value, dict | list):
            for part in value.values() if isinstance(value, dict) else value:
                yield from leaves(part)
        else:
            yield value

    assert {type(leaf) for leaf in leaves(report)} == {str, int, float}


def test_seconds_are_added_up_by_stage_over_turns_and_threads():
    watch = Stopwatch(torch.device("cpu"))

    def turn():
        with watch.stage("edge"):
            time.sleep(0.001)

    threads = [threading.Thread(target=turn) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with watch.stage("start"):
        pass
    assert set(watch.seconds) == {"edge", "start"}
    assert watch.seconds["edge"] >= 0.003  # of three threads together
    assert watch.seconds["start"] >= 0


def test_a_stage_that_fails_is_not_swallowed():
    watch = Stopwatch(torch.device("cpu"))
    with pytest.raises(ZeroDivisionError), watch.stage("edge"):
        raise ZeroDivisionError
    assert watch.seconds == {}


@pytest.mark.parametrize("size", [1, 3, 9])
def test_every_fourth_frame_of_the_clip_is_looked_at_however_it_is_cut(size):
    """A leaning tube whose body is too wide in frame 4 alone, of nine."""
    mesh, body = tube(), cylinder_body()
    cloth = torch.from_numpy(np.stack([mesh.vertices] * 9)).float()
    bodies = np.stack([body.vertices] * 9)
    bodies[4] *= [1.2, 1, 1]
    bodies[5] *= [1.3, 1, 1]
    inputs = inputs_of(initial=cloth, body=(bodies, body.faces))
    report, found = CrossingReport(mesh, torch.device("cpu")), []
    obstacle = make_obstacle(inputs, FusionConfig(), torch.device("cpu"), Topology(mesh))
    for first in range(0, 9, size):
        frames = slice(first, first + size)
        pose(obstacle, inputs.part(frames))
        before, after = (
            (part, obstacle.query(part).distance) for part in (cloth[frames] + 10, cloth[frames])
        )
        found.append(report.fractions(after[0], first, ClothAndBody(obstacle.surface, before, after)))
    before, after = (np.concatenate([part.body[k] for part in found if part.body]) for k in (0, 1))
    assert before.tolist() == [0, 0, 0]  # ten metres away
    assert (after > 0).tolist() == [False, True, False]
    assert after[1] == body_crossing_fractions(cloth[4:5].numpy(), mesh.faces, bodies[4:5], body.faces)[0]
    assert np.concatenate([part.itself for part in found]).tolist() == [0, 0, 0]
