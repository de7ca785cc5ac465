"""Rates that rounded frame times stand for."""

import pytest

from imgtransfer.motions.frame_rates import rate_of_frame_time


@pytest.mark.parametrize(("written", "rate"), [
    ("0.03333333", 30), ("0.033333", 30), ("0.0333", 30), ("0.033", 30), ("3.333e-2", 30),
    ("0.0333667", 30 / 1.001), ("0.0083333", 120), ("0.00833", 120), ("0.0083", 120), (".0083333", 120),
    ("0.0166667", 60), ("0.01667", 60), ("0.0167", 60), ("0.0166", 60), ("0.017", 60),
    ("0.041667", 24), ("0.0417", 24), ("0.04", 25), ("0.02", 50), ("0.01", 100), ("0.0111111", 90),
    ("0.00416667", 240), ("0.016", 62.5), ("0.008", 125), ("0.03030303", 33), ("0.07", 15), ("0.5", 2), ("1", 1),
    ("0.0137", 73), ("0.0035", 1 / 0.0035), ("2.5", 0.4),
])  # fmt: skip
def test_the_usual_rate_with_these_digits_is_meant(written, rate):
    assert rate_of_frame_time(written) == rate


@pytest.mark.parametrize("written", ["0", "-0.1", "nan", "inf"])
def test_what_is_no_time_is_no_rate(written):
    with pytest.raises(OverflowError):
        rate_of_frame_time(written)


def test_words_are_no_number():
    with pytest.raises(ValueError, match="soon"):
        rate_of_frame_time("soon")
