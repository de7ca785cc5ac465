"""Metrics as text."""

import json

import pytest

from imgtransfer.evaluation.config import EvaluateConfig, StedConfig
from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells, metrics_json, metrics_table

VALUES = dict(zip(METRICS, (1.005, 22.0, 333.456, 0.00012, 0.0001, 0.0005, 4.5678, 0.1, 12.0), strict=True))


def test_every_metric_has_a_heading_and_its_own_digits():
    assert len(HEADINGS) == len(METRICS)
    cells = metric_cells(dict.fromkeys(METRICS, 2 / 3))
    assert cells == ["0.67", "0.67", "0.67", "0.6667", "0.6667", "0.6667", "0.667", "0.667", "0.667"]


def test_cells_come_in_the_metrics_order_whatever_the_mappings():
    assert metric_cells(dict(reversed(VALUES.items()))) == metric_cells(VALUES)


def test_a_table_lines_up_and_has_a_row_a_name():
    lines = metrics_table(
        {"a/b": VALUES, "overall": {k: 10 * v for k, v in VALUES.items()}}, first="method"
    ).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[0].split()[0] == "method"
    assert lines[2].split() == ["a/b", *metric_cells(VALUES)]
    assert lines[3].split()[0] == "overall"


def test_names_that_look_like_numbers_stay_names():
    assert metrics_table({"0010": VALUES}).splitlines()[2].split()[0] == "0010"


def test_values_that_are_not_finite_are_shown_as_such():
    assert metric_cells(VALUES | {"rms_mm": float("nan")})[1] == "nan"


def test_a_metric_that_is_missing_is_an_error_and_no_empty_cell():
    with pytest.raises(KeyError, match="sted"):
        metric_cells({key: value for key, value in VALUES.items() if key != "sted"})


def test_json_holds_all_digits():
    config = EvaluateConfig(sted=StedConfig(frame_step=0.01))
    text = metrics_json({"a": VALUES}, VALUES, config)
    assert json.loads(text) == {
        "clips": {"a": VALUES},
        "overall": VALUES,
        "config": {"sted": {"distance": 1, "window": 11, "temporal_weight": 0.136, "frame_step": 0.01}},
    }
