"""Clips compared, and made to survive storing to the bit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from imgtransfer.data import grid
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment


def assert_same_clip(a: Clip, b: Clip) -> None:
    x, y = a.arrays(), b.arrays()
    assert x.keys() == y.keys()
    for key in x:
        assert x[key].dtype == y[key].dtype, key
        np.testing.assert_array_equal(x[key], y[key], err_msg=key)
    assert (a.fps, a.texts()) == (b.fps, b.texts())


def with_arrays(clip: Clip, **arrays: Any) -> Clip:
    """The clip with other arrays, or `fps`, by their names in files; without those that are None."""
    fps = arrays.pop("fps", clip.fps)
    both = clip.arrays() | arrays
    left = {key: values for key, values in both.items() if values is not None}
    return Clip.of_arrays(left, fps=fps, info=clip.texts(), name=clip.name)


def on_grid(clip: Clip) -> Clip:
    return replace(
        clip,
        garment=Garment(grid.round_to_grid(clip.garment.vertices)),
        body=replace(clip.body, vertices=grid.round_to_grid(clip.body.vertices)),
    )
