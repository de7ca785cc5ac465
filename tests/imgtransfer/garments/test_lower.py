"""Skirts and trousers on bodies of cylinders, where their distance to the body is known by hand."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from imgtransfer.garments.config import SkirtConfig, TrousersConfig
from imgtransfer.garments.lower import lower_field, waistband
from tests.helpers.figures import figure_of, rod, trunk

RADIUS = 0.15


def sampled(field, points):
    return map_coordinates(
        field.values, ((np.array(points) - field.low) / field.cell).T, order=1, mode="nearest"
    )


def level(field, height, direction):
    """How far from the vertical axis the field is 0 at a height, in a direction (x, z)."""
    reach = np.linspace(0, 0.4, 801)
    points = np.stack([reach * direction[0], np.full(801, height), reach * direction[1]], axis=1)
    return reach[np.argmin(np.abs(sampled(field, points)))]


def test_a_skirt_on_a_cylinder_is_snug_at_the_waist_and_flares_below():
    figure, config = figure_of(trunk(RADIUS)), SkirtConfig(flare=0.3, ease=0.03, waist_ease=0.01, length=0.4)
    top = waistband(figure, config)
    field = lower_field(figure, config)
    for direction in ((1, 0), (0, -1), (0.6, 0.8)):
        # Half of the ease's rise, 3 s² - 2 s³ at s = 1/2, lies 0.05 m below the band, and there the flare begins.
        assert level(field, top, direction) == pytest.approx(RADIUS + 0.01, abs=0.002)
        assert level(field, top - 0.05, direction) == pytest.approx(RADIUS + 0.02, abs=0.003)
        assert level(field, top - 0.2, direction) == pytest.approx(RADIUS + 0.03 + 0.3 * 0.15, abs=0.002)


def test_the_waistband_is_moved_from_the_natural_waist():
    figure = figure_of(trunk(RADIUS))
    assert waistband(figure, SkirtConfig(waist=-0.05)) == pytest.approx(figure.waist - 0.05)
    assert waistband(figure, TrousersConfig()) == figure.waist


def two_legs():
    """Hips of radius 0.17 down to y = -0.15, and two legs of radius 0.06, 0.2 m apart."""
    legs = [rod((sign * 0.1, -0.1, 0), (sign * 0.1, -0.95, 0), 0.06) for sign in (1, -1)]
    return figure_of(rod((0, -0.15, 0), (0, 0.7, 0), 0.17), *legs)


@pytest.fixture(scope="module")
def trousers():
    return lower_field(two_legs(), TrousersConfig(flare=0.0, ease=0.025, length=0.3))


def test_trouser_legs_keep_their_ease_and_stay_apart(trousers):
    heights = np.array([-0.24, -0.3])
    outside = [[0.1 + 0.06 + 0.025, height, 0] for height in heights]
    assert (
        np.abs(sampled(trousers, outside)).max() < 0.003
    )  # smoothing shifts a cylinder's by width² / 2 radius
    between = [[x, height, z] for x in (-0.004, 0, 0.004) for height in heights for z in (-0.05, 0, 0.05)]
    assert sampled(trousers, between).min() > 0
    assert sampled(trousers, [[0, -0.05, 0]]) < 0  # above the crotch there is one garment


def test_trousers_of_a_symmetric_body_are_symmetric(trousers):
    points = np.random.default_rng(0).uniform([0, -0.33, -0.2], [0.2, 0.1, 0.2], (200, 3))
    left, right = sampled(trousers, points), sampled(trousers, points * [-1, 1, 1])
    np.testing.assert_allclose(left, right, atol=0.002)  # the grid need not be


def test_trousers_nowhere_pass_through_the_skin(trousers):
    body = two_legs().vertices
    covered = body[(body[:, 1] > -0.33) & (body[:, 1] < 0.05)]
    assert sampled(trousers, covered).max() < -TrousersConfig().waist_ease / 2 + 0.002
