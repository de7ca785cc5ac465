"""The frame rate that a rounded frame time stands for."""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation

# Of cameras and capture systems, and of NTSC video; other whole rates are found where enough digits show them.
_USUAL = (
    30,
    60,
    120,
    24,
    25,
    50,
    48,
    12,
    15,
    72,
    75,
    90,
    100,
    144,
    150,
    180,
    200,
    240,
    250,
    300,
    480,
    500,
    1000,
)
_VIDEO = tuple(rate / 1.001 for rate in (24, 30, 60, 120, 240))


def rate_of_frame_time(written: str) -> float:
    """Frames a second of a frame time in seconds as a file writes it: "0.0333", "0.03333333" are 30.

    The rate is the first of these whose frame time is the given one: a whole number, exactly; a usual rate, then
    another whole one, rounded to the digits that are written; a usual rate, cut off after them. Otherwise it is the
    reciprocal.

    Raises:
        ValueError: not a number. OverflowError: no rate, which a frame time of 0 has.
    """
    seconds = float(written)
    if not seconds > 0 or not math.isfinite(seconds):
        raise OverflowError(written)
    rate = 1 / seconds
    if not 0.5 < rate < 1e5:
        return rate
    whole = float(max(round(rate), 1))
    if abs(rate - whole) <= 1e-9 * rate:
        return whole
    try:
        exponent = Decimal(written).as_tuple().exponent
    except InvalidOperation:
        return rate
    digit = 10.0**exponent if isinstance(exponent, int) else 0.0
    told_apart = (whole,) if 1 / whole - 1 / (whole + 1) > digit else ()
    for likely in (*_USUAL, *_VIDEO, *told_apart):
        if abs(1 / likely - seconds) <= min(0.501 * digit, 0.05 * seconds):
            return float(likely)
    for likely in (*_USUAL, *_VIDEO):
        if 0 <= 1 / likely - seconds <= min(digit, 0.02 * seconds):
            return float(likely)
    return rate
