"""The order that people mean by numbers in names."""

from pathlib import Path

import pytest

from render.files.naming import natural, natural_sort


@pytest.mark.parametrize(
    "names",
    [
        ["frame_2.obj", "frame_10.obj"],
        ["a9b10.obj", "a10b2.obj"],
        ["1.obj", "02.obj", "10.obj"],
        ["Shirt_1.obj", "shirt_2.obj", "SHIRT_3.obj"],  # capitals do not count
        ["walk", "walk1", "walk1a", "walk2"],
        ["9" * 40, "1" + "0" * 40],  # longer than any machine number
        ["x٢", "x10"],  # two, in Arabic digits
    ],
)
def test_numbers_go_by_their_value(names):
    paths = [Path("some_9_folder") / name for name in names]
    assert natural_sort(reversed(paths)) == paths
    assert sorted(reversed(names), key=natural) == names


def test_only_the_name_counts_and_not_the_folder():
    paths = [Path("z/1.obj"), Path("a/2.obj")]
    assert natural_sort(paths[::-1]) == paths


def test_superscripts_are_no_numbers():
    """² is a digit to Python and no decimal; `int` would refuse it."""
    assert natural("m²") == [(0, 0, "m²")]
