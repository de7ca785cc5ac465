"""Patches over a garment's images, and how they blend."""

from __future__ import annotations

import numpy as np

from imgtransfer.network.head_patches import BLEND_M, blend_weights, mirrored_pixels, patches_over


def sheet(side: int = 24) -> np.ndarray:
    """(side², 3) points of a sheet of half a metre."""
    line = np.linspace(0, 0.5, side)
    return np.stack([*(axis.ravel() for axis in np.meshgrid(line, line)), np.zeros(side**2)], axis=-1)


def test_every_pixel_has_patches_whose_weights_sum_to_one() -> None:
    points = sheet()
    patches = patches_over(points, points[::7], np.ones(len(points[::7]), bool), 6)
    assert len(patches.tokens) == 6
    total = np.zeros(len(points))
    for pixels, blend in zip(patches.pixels, patches.blend, strict=True):
        assert (blend > 0).all()
        total[pixels] += blend
    np.testing.assert_allclose(total, 1, atol=1e-6)


def test_tokens_without_cloth_are_no_centres() -> None:
    points = sheet()
    covered = np.arange(len(points[::7])) % 2 == 0
    patches = patches_over(points, points[::7], covered, 500)
    assert covered[patches.tokens].all()
    assert len(patches.tokens) <= covered.sum()


def test_blending_has_no_seams() -> None:
    """Along a line over the borders of patches weights change by no more than the slope that `BLEND_M` allows."""
    centres = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.1, 0.15, 0], [0.3, 0.1, 0.05]])
    steps = np.linspace(-0.1, 0.4, 5001)
    weights = blend_weights(np.stack([steps, 0.3 * steps, 0 * steps], axis=-1), centres)
    assert (weights.max(axis=0) > 0.25).all()  # the line meets all of them
    length = (steps[1] - steps[0]) * np.hypot(1, 0.3)
    assert np.abs(np.diff(weights, axis=0)).max() < 8 * length / BLEND_M
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_mirrored_pixels_by_hand() -> None:
    mask = np.array([[[1, 1, 0, 1], [0, 1, 1, 0]], [[0, 0, 0, 1], [1, 0, 0, 0]]], bool)
    # Row 0 of the first view: columns 0, 1, 3; the mirror image of column 1 is column 2, of which 1 and 3 are as near.
    other = mirrored_pixels(mask)
    assert [other[0], other[2], other[3], other[4]] == [2, 0, 4, 3]
    assert other[1] in (1, 2, 4)
    # The second view's pixels stay in it, at whatever distance.
    assert set(other[5:]) <= {5, 6}
