"""Sheets about maps: what they show, by hand."""

from __future__ import annotations

import numpy as np

from imgtransfer.report.map_pictures import difference_sheet, frames_sheet, template_sheet
from render import Mesh, TemplateImager
from render.pictures import heat_colours
from tests.helpers.synthetic import tube


def has(sheet: np.ndarray, colour: tuple[int, int, int]) -> bool:
    return bool((sheet == colour).all(-1).any())


def test_vertices_seen_here_elsewhere_and_nowhere() -> None:
    outer, faces = tube(0.2, 0.6, 12, 16, closed=False)
    red, grey, green = (210, 30, 30), (150, 150, 150), (30, 120, 60)
    both = TemplateImager.build(Mesh(outer, faces), size=(48, 32), backend="numpy")
    sheet = template_sheet(both, title="tube")
    assert has(sheet, green)
    assert has(sheet, grey)  # the other view's
    assert not has(sheet, red)
    # A closed tube around it hides the inner one from all sides.
    inner, inside = tube(0.1, 0.4, 6, 8, closed=False)
    around, cover = tube(0.2, 0.6, 12, 16, closed=True)
    nested = Mesh(
        np.concatenate([around, inner + np.float32([0, 0.1, 0])]),
        np.concatenate([cover, inside + len(around)]),
    )
    hidden = template_sheet(TemplateImager.build(nested, size=(48, 32), backend="numpy"), title="nested")
    assert has(hidden, red)
    assert hidden.shape[1] == 2 * 32 * 11 + 3 * 4  # 512 pixels high, hence 11 times as large; gaps of 4


def test_the_difference_has_one_scale_for_all_frames() -> None:
    distance = np.zeros((2, 1, 20, 80), np.float32)
    distance[0, 0, :, :40], distance[1] = 2.0, 8.0
    mask = np.ones((1, 20, 80), bool)
    mask[0, 0] = False
    sheet = difference_sheet(distance, mask, ["front"], frames=(3, 9), title="t")
    first, second = sheet[64:84, 4:84], sheet[108:128, 4:84]  # below title, column and row labels
    assert (first[0] == 255).all()
    np.testing.assert_array_equal(first[5, 5], heat_colours(np.array([0.25]))[0])
    np.testing.assert_array_equal(first[5, 60], heat_colours(np.array([0.0]))[0])
    np.testing.assert_array_equal(second[5, 5], heat_colours(np.array([1.0]))[0])


def test_no_difference_is_drawn_dark() -> None:
    mask = np.ones((1, 20, 80), bool)
    sheet = difference_sheet(np.zeros((1, 1, 20, 80)), mask, ["front"], frames=(0,), title="t")
    np.testing.assert_array_equal(sheet[70, 10], heat_colours(np.array([0.0]))[0])


def test_frames_stand_side_by_side_and_show_the_motion() -> None:
    vertices, faces = tube(0.2, 0.6, 12, 16, closed=False)
    moving = np.stack([vertices, vertices + np.float32([0.3, 0, 0])])
    sheet = frames_sheet([(moving, faces)], ["garment"], (0, 7), backend="auto", title="t")
    height, width = sheet.shape[0] - 48, (sheet.shape[1] - 12) // 2
    drawn = [(sheet[44:, 4 + k * (width + 4) :][:height, :width] < 250).any(-1) for k in range(2)]
    columns = [np.flatnonzero(picture.any(0)).mean() for picture in drawn]
    assert columns[1] - columns[0] > 0.2 * width
