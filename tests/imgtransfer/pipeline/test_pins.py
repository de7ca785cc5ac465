"""Pins from the files that people have."""

import numpy as np
import pytest

from imgtransfer.pipeline.pins import Pins, load_pins
from render import InputError

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_pins_from_text(tmp_path):
    path = tmp_path / "pins.txt"
    path.write_text("3, 1\n# all of them: 9\n7;8  # the collar\n")
    assert load_pins(path).indices.tolist() == [3, 1, 7, 8]
    assert load_pins(path).over(5) is None
    for text, message in (
        ("3 x", "line 1: vertex numbers from 0 are wanted, found 'x'"),
        ("# 1", "no vertex numbers"),
        ("", "no vertex numbers"),
        ("-1", "found '-1'"),
        ("²", "found '²'"),
        ("٣", "found '٣'"),
        ("1_0", "found '1_0'"),
        ("1e3", "found '1e3'"),
        ("9" * 5000, "found '9999"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            load_pins(path)


def test_pins_with_places(tmp_path):
    path = tmp_path / "pins.npz"
    np.savez(path, indices=np.array([3, 1]), positions=SQUARE[:2])
    assert load_pins(path).over(3).shape == (3, 2, 3)
    np.savez(path, indices=np.array([3, 1]), positions=np.stack([SQUARE[:2]] * 2))
    np.testing.assert_array_equal(load_pins(path).over(2)[1], SQUARE[:2])
    with pytest.raises(InputError, match="positions of 2 frames, but the maps have 3"):
        load_pins(path).over(3)
    for arrays, message in (
        ({"positions": SQUARE}, "lacks indices"),
        ({"indices": np.array([0.5])}, "indices must be whole numbers"),
        ({"indices": np.array([1]), "positions": SQUARE}, r"positions must have shape \(1, 3\)"),
        ({"indices": np.array([1]), "positions": np.full((1, 3), np.nan)}, "not finite"),
        ({"indices": np.array([1]), "positions": np.full((1, 3), 1e30)}, "beyond ±10000 m"),
        ({"indices": np.array([1]), "positions": np.float64(1)}, r"positions must have shape \(1, 3\)"),
        ({"indices": np.array([1]), "positions": np.array([["a", "b", "c"]])}, "numbers are wanted"),
        ({"indices": np.array([3, -1])}, "vertex numbers from 0, found -1"),
        ({"indices": np.array([2**63], np.uint64)}, "vertex numbers from 0, found 9223372036854775808"),
        ({"indices": np.int64(1)}, "indices must be whole numbers"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message):
            load_pins(path)


def test_pins_beyond_the_garment_are_named_with_their_file(tmp_path):
    (tmp_path / "pins.txt").write_text("1 7")
    pins = load_pins(tmp_path / "pins.txt")
    pins.check(8)
    with pytest.raises(InputError, match=r"pins\.txt: vertex 7 is wanted, but the garment has 0\.\.6"):
        pins.check(7)


def test_pins_without_places_stay():
    assert Pins(np.array([1])).over(2) is None
