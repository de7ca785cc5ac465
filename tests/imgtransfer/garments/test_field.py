"""Fields on a grid: their places, their zero level, distances and hulls whose values are known."""

import numpy as np
import pytest
import trimesh

from imgtransfer.garments.cutting import border_loops, components
from imgtransfer.garments.field import Field, body_distance, hanging, hull_distance
from imgtransfer.garments.figure import ANGLES

CELL = 0.05


def grid(low=(-0.5, -0.5, -0.5), shape=(21, 21, 21), cell=CELL):
    return Field(np.zeros(shape), np.array(low, float), cell)


def ball(radius=0.3, centre=(0, 0, 0), **options):
    empty = grid(**options)
    return empty.with_values(np.linalg.norm(empty.points - np.array(centre), axis=-1) - radius)


def volume(mesh):
    corners = mesh.vertices[mesh.faces]
    return np.einsum("fx,fx->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def test_points_and_heights_by_hand():
    field = grid((1.0, 2.0, 3.0), (2, 3, 4), 0.5)
    assert field.heights.tolist() == [2.0, 2.5, 3.0]
    assert field.points.shape == (2, 3, 4, 3)
    assert field.points[1, 2, 3].tolist() == [1.5, 3.0, 4.5]
    assert field.points[0, 1, 0].tolist() == [1.0, 2.5, 3.0]


@pytest.mark.parametrize("cell", [0.02, 0.04])
def test_smoothing_is_as_wide_as_it_says_in_metres_whatever_the_cell(cell):
    width, n = 0.08, round(1.6 / cell) + 1
    spike = grid((-0.8, 0, 0), (n, 3, 3), cell)
    values = spike.values.copy()
    values[n // 2] = 1.0  # a sheet in the middle: along the other axes there is nothing to smooth
    line = spike.with_values(values).smoothed(width).values[:, 1, 1]
    x = spike.points[:, 1, 1, 0]
    assert line.sum() == pytest.approx(1)
    assert np.sqrt(line @ x**2) == pytest.approx(width, rel=0.01)


def test_the_surface_of_a_ball_is_closed_seen_from_outside_and_as_large():
    mesh = ball().surface("a ball")
    assert mesh.source == "a ball"
    assert border_loops(mesh.faces) == []
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.02)  # negative, were it inside out
    # Along an edge of the grid the distance bends by cell² / (8 radius) at most.
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 0.3, atol=CELL**2 / (8 * 0.3) + 1e-6)


def test_of_several_pieces_the_largest_is_the_surface():
    small, large = ball(0.12, (-0.3, 0, 0)), ball(0.2, (0.25, 0, 0))
    mesh = small.with_values(np.minimum(small.values, large.values)).surface("balls")
    assert components(mesh) == 1
    assert mesh.vertices[:, 0].min() > 0.04


def test_the_surface_is_open_where_the_grid_ends():
    mesh = ball(centre=(0, -0.5, 0)).surface("half a ball")
    loops = border_loops(mesh.faces)
    assert len(loops) == 1
    np.testing.assert_allclose(mesh.vertices[loops[0], 1], -0.5)


@pytest.mark.parametrize("slope", [0.7, 1.0, 3.0])
def test_points_are_projected_straight_onto_a_plane(slope):
    normal = np.array([2.0, -1.0, 2.0]) / 3
    field = grid()
    field = field.with_values(slope * (field.points @ normal - 0.1))
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    wanted = points - (points @ normal - 0.1)[:, None] * normal
    np.testing.assert_allclose(field.project(points), wanted, atol=1e-12)


def test_points_in_a_flat_field_stay_and_in_a_nearly_flat_one_do_not_fly_off():
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3))
    flat = grid().with_values(np.full((21, 21, 21), 0.5))
    np.testing.assert_allclose(flat.project(points), points, atol=1e-12)
    nearly = grid()
    nearly = nearly.with_values(0.5 + 1e-3 * nearly.points[..., 0])
    assert np.abs(nearly.project(points) - points).max() < 0.01


def test_the_distance_to_a_box_by_hand_and_no_farther_than_the_band():
    box = trimesh.creation.box((0.4, 0.6, 0.2))
    field = body_distance(box.vertices, box.faces, np.full(3, -0.5), np.full(3, 0.52), cell=CELL, band=0.15)
    assert field.values.shape == (22, 22, 22)  # whole cells that reach the upper corner
    x, y, z = (field.points[..., axis] for axis in range(3))
    apart = np.stack([np.abs(x) - 0.2, np.abs(y) - 0.3, np.abs(z) - 0.1])
    wanted = np.linalg.norm(np.maximum(apart, 0), axis=0) + np.minimum(apart.max(axis=0), 0)
    on_skin = np.abs(wanted) < 1e-6  # there the sign is rounding's
    np.testing.assert_allclose(field.values[~on_skin], np.minimum(wanted, 0.15)[~on_skin], atol=1e-6)


def test_the_distance_to_a_square_section_is_exact_inside_and_less_at_its_corners():
    field, half = grid(shape=(21, 2, 21)), 0.2
    square = half * (np.abs(np.cos(ANGLES)) + np.abs(np.sin(ANGLES)))
    distance = hull_distance(field, np.zeros(3), np.stack([square, square]))
    x, z = np.abs(field.points[:, 0, :, 0]), np.abs(field.points[:, 0, :, 2])
    inside = (x < half) & (z < half)
    np.testing.assert_allclose(distance[:, 0][inside], (np.maximum(x, z) - half)[inside], atol=1e-12)
    before = (x >= half) & (z < 1e-9)
    np.testing.assert_allclose(distance[:, 1][before], (x - half)[before], atol=1e-12)
    corner = (x > half) & (z > half)
    true = np.hypot(x - half, z - half)
    assert (distance[:, 0][corner] > 0).all()
    assert (distance[:, 0][corner] <= true[corner] + 1e-12).all()


def test_sections_are_measured_from_their_axis_at_each_height():
    field = grid(shape=(21, 3, 21))
    radii = np.array([0.1, 0.2, 0.3])
    distance = hull_distance(field, np.array([0.1, 7.0, -0.2]), np.repeat(radii[:, None], 64, axis=1))
    # In one of the 64 directions a circle's tangent is met head-on.
    np.testing.assert_allclose(distance[20, :, 6], 0.4 - radii, atol=1e-12)  # the point (0.5, y, -0.2)
    np.testing.assert_allclose(distance[12, :, 6], -radii, atol=1e-12)  # the axis itself


def stacked(widths):
    return np.repeat(np.array(widths, float)[:, None], 64, axis=1)


def test_cloth_falls_straight_from_the_widest_section_and_is_the_bodys_above():
    heights = 0.01 * np.arange(80)
    widths = np.where((heights > 0.295) & (heights < 0.405), 0.3, 0.1)  # a bulge
    widths[60:] = 0.5  # wider still, but above what hangs
    sections = hanging(stacked(widths), heights, 0.455)
    assert np.array_equal(sections, np.repeat(sections[:, :1], 64, axis=1))
    section = sections[:, 0]
    # Steps are smoothed over 8 heights either way; farther off they are what they were.
    np.testing.assert_allclose(section[:32], 0.3)
    np.testing.assert_allclose(section[69:], 0.5)
    assert section[50] == pytest.approx(0.1, abs=0.004)
    assert (np.diff(section[:46]) <= 1e-12).all()  # never narrower farther down


def test_heights_without_a_body_take_the_section_above_them():
    widths = stacked([0.2] * 10 + [0.4] * 30)
    widths[:10] = np.nan
    np.testing.assert_allclose(hanging(widths, 0.01 * np.arange(40), 1.0), 0.4)


def test_a_missing_section_at_the_top_takes_the_last_one():
    widths = stacked([0.2] * 20)
    widths[-3:, 5] = np.nan
    np.testing.assert_allclose(hanging(widths, 0.01 * np.arange(20), -1.0), 0.2)
