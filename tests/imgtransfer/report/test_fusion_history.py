"""What a fusion reports: units in the table, weights in the picture."""

import numpy as np
import pytest

from fusion import FusionConfig
from fusion.stages import edge_weights, normal_weights
from imgtransfer.report.fusion_history import TERMS, fusion_table, history_picture


def report(**changes):
    terms = {
        "edge_length_m2": (4e-6, 1e-8),  # 2 mm and 0.1 mm
        "collision_m": (0.003, 0.0),
        "normal_rendering": (0.25, 0.125),
    }
    ends = {
        end: {name: pair[number] for name, pair in terms.items()}
        for number, end in enumerate(("start", "end"))
    }
    rest = {
        "unseen_percent": 12.25,
        "self_crossing_percent": 0.5,
        "stage_seconds": {"edge": 1.25, "normal": 2.0},
        "seconds": 3.5,
        "frames": 7,
    }
    return {"terms": {"edge": ends}} | rest | changes


def row(text, name):
    (line,) = [line for line in text.splitlines() if name in line]
    return line.split()


def test_residuals_are_in_millimetres_where_they_are_lengths():
    table = fusion_table(report())
    assert row(table, "edge length off")[-3:] == ["2", "0.1", "mm"]
    assert row(table, "depth in the obstacle")[-3:] == ["3", "0", "mm"]
    assert row(table, "rendered normal")[-2:] == ["0.25", "0.125"]


def test_the_lines_below_the_table():
    assert fusion_table(report()).splitlines()[-3:] == [
        "unseen   12.25 % of the vertices are in no view",
        "crossing 0.500 % of the edges pass through the garment itself",
        "seconds  3.50 for 7 frames: edge 1.25, normal 2.00",
    ]
    inside = fusion_table(report(penetration_percent={"before_clearance": 4.5, "after": 0.0}))
    assert "inside   4.500 % of the vertices, 0.000 % after the clean-up" in inside
    crossing = fusion_table(report(crossing_percent={"before_clearance": 2.0, "after": 1.0}))
    assert (
        "crossing 2.000 % of the edges with the body, 1.000 % after the clean-up; 0.500 % with the garment itself"
        in crossing
    )


def test_a_report_without_stages_has_no_table():
    lines = fusion_table(report(terms={}, stage_seconds={})).splitlines()
    assert [line.split()[0] for line in lines] == ["unseen", "crossing", "seconds"]


def test_every_term_that_a_fusion_minimises_has_a_name():
    config = FusionConfig()
    for stage, weights in (("edge", edge_weights(config)), ("normal", normal_weights(config))):
        assert set(weights) <= set(TERMS)
        terms = {stage: {end: dict.fromkeys(weights, 1e-4) for end in ("start", "end")}}
        assert len(fusion_table(report(terms=terms)).splitlines()) == 2 + len(weights) + 3


FALL = np.geomspace(1e-4, 1e-6, 20)


def history():
    return {
        "edge": {"total": FALL, "edge_length_m2": FALL / 2},
        "normal": {"total": FALL, "normal_rendering": FALL},
    }


def test_a_picture_has_a_panel_for_each_stage_and_draws_curves():
    both = history_picture(history(), FusionConfig())
    one = history_picture({"edge": history()["edge"]}, FusionConfig())
    assert both.dtype == np.uint8
    assert both.shape[0] == one.shape[0]
    assert both.shape[1] == pytest.approx(2 * one.shape[1], rel=0.05)
    coloured = np.ptp(one.astype(int), axis=2) > 60
    assert coloured.sum() > 100


def test_terms_are_drawn_as_they_are_weighted_and_zeros_left_out():
    def drawn(weight, scale):
        lengths = scale * np.geomspace(1e-8, 1e-9, 20)
        lengths[7] = 0  # a logarithm has none
        config = FusionConfig(weight_edge=weight)
        return history_picture({"normal": {"total": FALL, "edge_length_m2": lengths}}, config)

    assert np.array_equal(drawn(0.5, 8.0), drawn(2.0, 2.0))
    assert not np.array_equal(drawn(0.5, 8.0), drawn(2.0, 8.0))
