"""How much a page holds: pictures are counted, and made smaller together where they are too many bytes."""

from __future__ import annotations

import base64
from pathlib import Path

import cv2
import numpy as np
import pytest

from imgtransfer.report.data_page import ClipPart, ClipPicture, write_data_page
from imgtransfer.report.page_pictures import PICTURE_BYTES, PictureBudget, data_uri, fitting_uris


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(height).integers(0, 256, (height, width, 3), dtype=np.uint8)


def decoded(source: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(source.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


def test_a_budget_counts_what_fits_and_nothing_of_what_does_not() -> None:
    budget = PictureBudget(10)
    assert budget.take("1234", "56")
    assert not budget.take("1234", "5")
    assert budget.take("1234")
    assert budget.take()
    assert not budget.take("1")


def test_pictures_that_fit_are_kept_to_the_bit() -> None:
    images = [noise(20, 30), noise(10, 5)]
    sources, factor = fitting_uris(images, ("png", "webp"))
    assert factor == 1
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    for source, image in zip(sources, images, strict=True):
        np.testing.assert_array_equal(decoded(source), image)


def test_the_next_kind_is_taken_before_pictures_get_smaller() -> None:
    images = [noise(100, 100)]
    png, webp = (len(data_uri(kind, images[0])) for kind in ("png", "webp"))
    assert webp < png
    (source,), factor = fitting_uris(images, ("png", "webp"), limit=webp)
    assert source.startswith("data:image/webp;base64,")
    assert factor == 1


def test_too_large_pictures_all_get_smaller_by_one_factor() -> None:
    images = [noise(200, 300), noise(100, 100)]
    limit = 20_000
    sources, factor = fitting_uris(images, ("png", "jpeg"), limit=limit)
    assert limit / 2 < sum(map(len, sources)) <= limit
    assert 0 < factor < 1
    for source, image in zip(sources, images, strict=True):
        assert decoded(source).shape == (round(factor * image.shape[0]), round(factor * image.shape[1]), 3)


def test_no_limit_is_so_small_that_it_never_ends() -> None:
    sources, _ = fitting_uris([noise(30, 40)], ("jpeg",), limit=1)
    assert decoded(sources[0]).shape == (1, 1, 3)
    assert fitting_uris([], ("png",)) == ([], 1.0)


def test_what_is_too_long_for_webp_is_a_jpeg() -> None:
    assert data_uri("webp", np.zeros((2, 16384, 3), np.uint8)).startswith("data:image/jpeg;")


@pytest.mark.parametrize("flagged", [0, 2])
def test_a_page_of_many_clips_keeps_the_pictures_of_those_to_look_at(flagged: int, tmp_path: Path) -> None:
    source = "data:image/jpeg;base64," + "A" * (PICTURE_BYTES // 2 - 1000)
    parts = [
        ClipPart(
            f"clip{n}", ("-",) * 10, ("jumps",) * (n == flagged), picture=ClipPicture(source, "four frames")
        )
        for n in range(3)
    ]
    page = write_data_page(tmp_path / "page.html", "Many", {}, parts).read_text()
    sections = [page.partition(f'<section id="clip{n}">')[2].partition("</section>")[0] for n in range(3)]
    assert source in sections[flagged]
    assert sum(source in section for section in sections) == 2
    assert "1 clips have no picture here" in page
