"""Curves out of a log, of which some lines may be damaged."""

import json

import pytest

from imgtransfer.report.logs import read_curves
from render import InputError


def log(tmp_path, *entries):
    path = tmp_path / "log.jsonl"
    lines = [entry if isinstance(entry, bytes) else json.dumps(entry).encode() for entry in entries]
    path.write_bytes(b"\n".join(lines) + b"\n")
    return path


def test_long_curves_are_means_over_even_blocks(tmp_path):
    path = log(tmp_path, *({"step": step, "loss": step**2} for step in range(10)))
    steps, values = read_curves(path, {"loss": "Loss"}, points=3)["Loss"]
    # Blocks of 4, 3 and 3 entries.
    assert steps == pytest.approx([1.5, 5, 8])
    assert values == pytest.approx([(0 + 1 + 4 + 9) / 4, (16 + 25 + 36) / 3, (49 + 64 + 81) / 3])


def test_curves_come_in_the_order_of_the_keys_and_without_what_no_line_has(tmp_path):
    path = log(tmp_path, {"step": 3, "b": 1, "a": 2.5}, {"step": 4})
    assert list(read_curves(path, {"a": "A", "none": "None", "b": "B"}).items()) == [
        ("A", ([3.0], [2.5])),
        ("B", ([3.0], [1.0])),
    ]
    assert read_curves(path, {}) == {}


def test_values_that_are_no_numbers_are_passed_over(tmp_path):
    path = log(
        tmp_path, {"step": 1, "a": "7"}, {"step": 2, "a": None}, {"step": 3, "a": 7}, {"step": 4, "a": [7]}
    )
    assert read_curves(path, {"a": "A"}) == {"A": ([3.0], [7.0])}


@pytest.mark.parametrize(
    "damaged",
    [
        b"",
        b"   ",
        b'{"step": 2, "a": 1',
        b"\xff\xfe",
        b"[1, 2]",
        b'{"a": 1}',
        b'{"step": true, "a": 1}',
        b'{"step": NaN, "a": 1}',
    ],
)
def test_a_damaged_line_costs_only_itself(tmp_path, damaged):
    path = log(tmp_path, {"step": 1, "a": 5}, damaged, {"step": 3, "a": 7})
    assert read_curves(path, {"a": "A"}) == {"A": ([1.0, 3.0], [5.0, 7.0])}


def test_a_log_of_damaged_lines_alone_is_none(tmp_path):
    with pytest.raises(InputError, match=r"log\.jsonl: not a training log of JSON lines with a step each"):
        read_curves(log(tmp_path, b"step 1 loss 2"), {"a": "A"})


def test_an_empty_log_has_no_curves(tmp_path):
    assert read_curves(log(tmp_path, b""), {"a": "A"}) == {}


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="log of a training run"):
        read_curves(tmp_path, {})
