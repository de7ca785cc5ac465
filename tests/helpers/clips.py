"""Clips compared, and made to survive storing to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imgtransfer.data import grid
from imgtransfer.data.clip import Clip
from imgtransfer.data.store import ARRAYS


def assert_same_clip(a: Clip, b: Clip) -> None:
    for key in ARRAYS:
        x, y = getattr(a, key), getattr(b, key)
        assert (x is None) == (y is None), key
        if x is not None:
            assert x.dtype == y.dtype, key
            np.testing.assert_array_equal(x, y, err_msg=key)
    assert (a.fps, a.info) == (b.fps, b.info)


def on_grid(clip: Clip) -> Clip:
    return replace(
        clip,
        garment_vertices=grid.round_to_grid(clip.garment_vertices),
        body_vertices=grid.round_to_grid(clip.body_vertices),
    )
