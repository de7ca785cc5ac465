import cv2
import numpy as np
import pytest

from render import InputError, contact_sheet, write_png
from render.pictures import difference_picture, heat_colours, map_sheet


def test_contact_sheet_places_images_in_a_grid():
    red, grey = np.zeros((10, 20, 3), np.uint8), np.full((10, 12), 0.5)
    red[..., 0] = 255
    sheet = contact_sheet([[red, grey], [grey]], gap=2)
    assert sheet.shape == (2 + 10 + 2 + 10 + 2, 2 + 20 + 2 + 12 + 2, 3)
    assert sheet.dtype == np.uint8
    np.testing.assert_array_equal(sheet[2:12, 2:22], red)
    np.testing.assert_array_equal(sheet[2:12, 24:36], 128)
    np.testing.assert_array_equal(sheet[14:24, 2:14], 128)
    assert (sheet[14:24, 14:] == 255).all()


def test_labels_are_written_outside_the_images():
    white = np.ones((30, 60, 3))
    sheet = contact_sheet([[white], [white]], row_labels=["a", "b"], column_labels=["c"], title="t", gap=0)
    assert sheet.shape == (20 + 20 + 2 * (20 + 30), 60, 3)
    for top in (0, 20, 40, 90):  # title, column label, row labels: some ink in each line
        assert (sheet[top : top + 20] < 128).any()
    for top in (60, 110):  # and none in the images
        assert (sheet[top : top + 30] == 255).all()


def test_unusable_sheets_are_refused():
    with pytest.raises(InputError, match="at least one image"):
        contact_sheet([[]])
    with pytest.raises(InputError, match="labels"):
        contact_sheet([[np.zeros((4, 4))]], row_labels=["a", "b"])
    with pytest.raises(InputError, match="shape"):
        contact_sheet([[np.zeros((4, 4, 2))]])


def test_map_sheet_has_a_row_a_frame_and_a_column_a_map_and_view():
    maps = {"position": np.zeros((3, 2, 8, 8, 3)), "normal": np.zeros((3, 2, 8, 8, 3))}
    maps["normal"][2, 1] = [0, 1, 0]
    mask = np.zeros((2, 8, 8), bool)
    mask[:, 2:6, 2:6] = True
    sheet = map_sheet(maps, mask, ("front", "back"), frames=(0, 2))
    assert len(sheet) == 20 + 2 * (20 + 8 + 4) + 4
    green = np.argwhere((sheet == [0, 255, 0]).all(-1))  # of the last row's fourth picture
    assert len(green) == 16
    assert (green[:, 0] >= len(sheet) - 12).all()
    left = 4 + sum(
        text_width(f"{name}, {view}") + 4 for name, view in [("position", "front"), ("position", "back")]
    )
    left += text_width("normal, front") + 4
    assert green[:, 1].min() == left + 2


def text_width(text):
    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)[0][0]


def test_no_text_is_cut_off_above_small_images():
    small = [np.ones((8, 8, 3))] * 2
    labels = ["front, position", "back, position"]
    sheet = contact_sheet([small], row_labels=["frame 12: mean over pixels 3.10 mm"], column_labels=labels)
    wide = contact_sheet([[np.ones((8, 300, 3))]], row_labels=["frame 12: mean over pixels 3.10 mm"])
    line = sheet[20 + 4 : 40 + 4]
    assert np.array_equal(line, wide[4 : 4 + 20, : line.shape[1]])
    assert (wide[:, line.shape[1] :] == 255).all()
    apart = 4 + text_width(labels[0])  # where the first label ends there is a gap before the second
    assert (sheet[:20, apart : apart + 4] == 255).all()
    assert (sheet[:20, :apart] < 128).any()
    assert (sheet[:20, apart + 4 :] < 128).any()


def test_difference_picture_by_hand():
    first, second = np.zeros((6, 40, 3)), np.zeros((6, 40, 3))
    second[:, :20] = [3, 0, 4]  # distance 5
    mask = np.ones((6, 40), bool)
    mask[0] = False
    picture = difference_picture(first, second, mask, unit="mm", limit=10)
    assert picture.shape == (6 + 44, 60, 3)
    assert (picture[:6, 40:] == 255).all()
    assert (picture[0] == 255).all()
    np.testing.assert_array_equal(picture[3, 3], heat_colours(np.array([0.5]))[0])
    np.testing.assert_array_equal(picture[3, 30], heat_colours(np.array([0.0]))[0])
    assert (picture[26:] < 128).any()  # the scale is labelled


def test_equal_maps_make_a_dark_picture():
    image = np.random.default_rng(0).random((5, 20, 3))
    picture = difference_picture(image, image, np.ones((5, 20), bool))
    assert (picture[:5, :20] == heat_colours(np.array([0.0]))[0]).all()


def test_difference_of_unlike_maps_is_refused():
    with pytest.raises(InputError, match="one shape"):
        difference_picture(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)), np.ones((4, 4), bool))
    with pytest.raises(InputError, match="0 pixels"):
        difference_picture(np.zeros((4, 4, 3)), np.zeros((4, 4, 3)), np.zeros((4, 4), bool))


def test_heat_colours_get_brighter():
    colours = heat_colours(np.linspace(-0.5, 1.5, 9)).astype(float).mean(axis=-1)
    assert (np.diff(colours)[2:6] > 0).all()
    assert colours[0] == colours[2]  # clipped
    assert colours[-1] == colours[6]


def test_png_is_rgb_on_disk(tmp_path):
    image = np.zeros((4, 6, 3))
    image[1, 2] = [1, 0.5, 0]
    write_png(tmp_path / "a" / "picture.png", image)
    stored = cv2.imread(str(tmp_path / "a" / "picture.png"))  # BGR
    assert stored.shape == (4, 6, 3)
    assert stored[1, 2].tolist() == [0, 128, 255]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["picture.png"]


def test_png_refuses_other_names(tmp_path):
    with pytest.raises(InputError, match=r"\.png"):
        write_png(tmp_path / "picture.jpg", np.zeros((4, 4, 3)))
