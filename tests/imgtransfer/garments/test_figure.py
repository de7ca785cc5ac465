"""What is measured on bodies of cylinders, whose sizes are known."""

from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.bodies.smpl import INDEX
from imgtransfer.garments.figure import ANGLES, Figure
from render import InputError
from tests.helpers.figures import figure_of, rod, standing_joints, trunk


@pytest.fixture(scope="module")
def person() -> Figure:
    """A trunk of radius 0.15 down to y = -0.15, arms of radius 0.04 and legs of radius 0.06 from y = -0.1."""
    arms = [rod((sign * 0.14, 0.5, 0), (sign * 0.9, 0.5, 0), 0.04) for sign in (1, -1)]
    legs = [rod((sign * 0.08, -0.1, 0), (sign * 0.08, -0.95, 0), 0.06) for sign in (1, -1)]
    return figure_of(rod((0, -0.15, 0), (0, 0.7, 0), 0.15), *arms, *legs)


def bent_arm() -> Figure:
    """The left upper arm goes 0.3 m to the side, the forearm 0.2 m forward."""
    joints = standing_joints()
    joints[INDEX["left_wrist"]] = [0.5, 0.5, 0.2]
    return replace(figure_of(trunk()), joints=joints)


@pytest.mark.parametrize(("fraction", "height"), [(0, -0.1), (1, -0.9), (0.5, -0.5), (-0.25, 0.1)])
def test_heights_along_the_legs(person, fraction, height):
    assert person.leg_height(fraction) == pytest.approx(height)


def test_uneven_hips_count_by_their_mean():
    joints = standing_joints()
    joints[INDEX["left_hip"], 1] += 0.04
    assert replace(figure_of(trunk()), joints=joints).leg_height(0) == pytest.approx(-0.08)


def test_an_arm_ends_past_the_fingertips_in_the_forearms_direction():
    wanted = [[0.2, 0.5, 0], [0.5, 0.5, 0], [0.5, 0.5, 0.2], [0.5, 0.5, 0.4]]
    np.testing.assert_allclose(bent_arm().arm("left"), wanted, atol=1e-12)


@pytest.mark.parametrize(("fraction", "end", "along"), [
    (0.0, [0.2, 0.5, 0], [1, 0, 0]),
    (0.3, [0.35, 0.5, 0], [1, 0, 0]),  # 0.15 of 0.5 m
    (0.8, [0.5, 0.5, 0.1], [0, 0, 1]),  # 0.4 m: 0.1 m past the elbow
    (1.0, [0.5, 0.5, 0.2], [0, 0, 1]),
])  # fmt: skip
def test_a_sleeve_ends_by_length_over_the_elbow(fraction, end, along):
    place, direction = bent_arm().sleeve_end("left", fraction)
    np.testing.assert_allclose(place, end, atol=1e-12)
    np.testing.assert_allclose(direction, along, atol=1e-12)


def test_shortened_arms_end_in_a_flat_section_and_leave_the_rest(person):
    short = person.shortened_arms(0.4)  # at 0.2 + 0.4 · 0.55 = 0.42 m
    assert np.abs(short[:, 0]).max() == pytest.approx(0.42)
    beyond = np.abs(person.vertices[:, 0]) > 0.42
    np.testing.assert_allclose(np.abs(short[beyond, 0]), 0.42)
    np.testing.assert_allclose(short[beyond, 1:], person.vertices[beyond, 1:], atol=1e-12)
    assert np.array_equal(short[~beyond], person.vertices[~beyond])


def test_wide_hands_are_drawn_in_to_an_arms_width():
    figure = figure_of(
        trunk(), rod((0.1, 0.5, 0), (0.7, 0.5, 0), 0.04), rod((0.7, 0.5, 0), (0.9, 0.5, 0), 0.1)
    )
    short = figure.shortened_arms(0.5)
    at_end = np.isclose(short[:, 0], 0.475)
    assert at_end.sum() > 100
    assert np.hypot(short[at_end, 1] - 0.5, short[at_end, 2]).max() <= 0.045 + 1e-12


def test_nearer_to_an_arm_is_told_by_the_skins_distance(person):
    points = np.array([[0.6, 0.54, 0], [0, 0.2, 0.15], [-0.6, 0.54, 0]])
    left, right = person.nearer_to_arm(points, "left"), person.nearer_to_arm(points, "right")
    assert left[0] > 0.3  # on the arm; the trunk is 0.45 m away
    assert left[1] < -0.2
    np.testing.assert_allclose(right, left[[2, 1, 0]], atol=0.03)
    assert left[2] < 0  # the other arm is neither this one nor the rest


def test_sections_of_a_cylinder_off_the_axis():
    figure = figure_of(rod((0.05, -0.5, 0), (0.05, 0.5, 0), 0.15))
    sections = figure.supports(np.array([-0.3, 0.0, 0.31]))
    # A polygon of 48 sides whose corners lie on the circle: at most radius · (1 - cos(π / 48)) within it.
    np.testing.assert_allclose(sections, np.tile(0.15 + 0.05 * np.cos(ANGLES), (3, 1)), atol=4e-4)


def test_sections_leave_out_arms_and_are_nan_off_the_body(person):
    sections = person.supports(np.array([0.5, 0.3, 0.9]))
    assert sections[0].max() < 0.35  # the shoulders; the arms reach to 0.9
    assert np.isfinite(sections[1]).all()
    assert np.isnan(sections[2]).all()


def test_both_legs_make_one_convex_section(person):
    section = person.supports(np.array([-0.6]))[0]
    assert section[0] == pytest.approx(0.14, abs=1e-3)  # towards +x: 0.08 + 0.06
    assert section[16] == pytest.approx(0.06, abs=1e-3)  # towards +z


def test_the_crotch_is_the_skin_that_looks_down_between_the_legs(person):
    assert person.crotch == pytest.approx(-0.15)


def test_a_body_without_parted_legs_has_no_crotch():
    with pytest.raises(
        InputError, match="no skin that looks down between its legs; a closed body mesh, y up"
    ):
        _ = figure_of(trunk()).crotch


def test_the_waist_is_the_narrowest_section_between_hips_and_ribs():
    # From the hip joints (-0.1) to the shoulders (0.5) it is looked for in [0.068, 0.272].
    hourglass = trunk()
    hourglass.vertices[:, [0, 2]] *= 1 + 4 * (hourglass.vertices[:, 1:2] - 0.19) ** 2
    assert figure_of(hourglass).waist == pytest.approx(0.19, abs=0.02)


def test_the_neck_begins_where_it_is_a_third_wider_than_at_its_narrowest():
    def half_width(height):
        return 0.05 + 0.4 * np.abs(height - 0.6)

    neck = rod((0, 0.3, 0.02), (0, 0.75, 0.02), 1.0)
    neck.vertices[:, [0, 2]] -= [0, 0.02]
    neck.vertices[:, [0, 2]] *= half_width(neck.vertices[:, 1:2])
    neck.vertices[:, 2] += 0.02
    centre, radius = figure_of(neck).neck
    assert 0.05 <= radius <= 0.05 + 0.4 * 0.01 + 1e-3  # of the widest place in a slice of 1 cm
    assert centre[1] == pytest.approx(0.6 - (1.33 * radius - 0.05) / 0.4, abs=0.01)
    np.testing.assert_allclose(centre[[0, 2]], [0, 0.02], atol=1e-3)
