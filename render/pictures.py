"""Pictures for eyes: contact sheets, map sheets and differences. Geometry never comes back from these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from render.errors import InputError
from render.files.atomic import written_whole

_WHITE, _BLACK = 255, (0, 0, 0)
_FONT, _FONT_SCALE, _LINE = cv2.FONT_HERSHEY_SIMPLEX, 0.4, 20  # a line of text takes 20 pixels


def contact_sheet(
    rows: Sequence[Sequence[np.ndarray]],
    *,
    row_labels: Sequence[str] | None = None,
    column_labels: Sequence[str] | None = None,
    title: str = "",
    gap: int = 4,
) -> np.ndarray:
    """Images in a labelled grid on white.

    Args:
        rows: rows of images, each (h, w, 3) or (h, w), uint8 or floating point in [0, 1] (clipped), RGB.
            Cells are as large as the largest image of their column and row, and as wide as their column's label;
            rows may be of different lengths.
        row_labels: one text a row, ASCII, written above it.
        column_labels: one text a column, ASCII, written at the top.
        title: text above everything.
        gap: pixels between images.

    Returns:
        (H, W, 3) uint8, RGB.

    Raises:
        InputError: no image at all, an image of another shape, or another number of labels than of rows or
            columns.
    """
    images = [[to_uint8(image) for image in row] for row in rows]
    columns = max((len(row) for row in images), default=0)
    if columns == 0:
        raise InputError("a contact sheet needs at least one image")
    for labels, wanted in ((row_labels, len(images)), (column_labels, columns)):
        if labels is not None and len(labels) != wanted:
            raise InputError(f"a contact sheet of {len(images)} x {columns} images got {len(labels)} labels")
    widths = [max(row[c].shape[1] for row in images if c < len(row)) for c in range(columns)]
    if column_labels is not None:
        widths = [max(width, _text_width(label)) for width, label in zip(widths, column_labels, strict=True)]
    heights = [max((image.shape[0] for image in row), default=0) for row in images]
    above = _LINE if row_labels else 0
    head = _LINE * (bool(title) + (column_labels is not None))
    across = max(_text_width(text) for text in (title, *(row_labels or ())))
    width = max(sum(widths) + gap * (columns + 1), gap * 2 + across)
    sheet = np.full((head + sum(heights) + (gap + above) * len(images) + gap, width, 3), _WHITE, np.uint8)
    lefts = [gap + sum(widths[:c]) + gap * c for c in range(columns)]
    if title:
        _write(sheet, title, gap, _LINE)
    for left, label in zip(lefts, column_labels or (), strict=False):
        _write(sheet, label, left, head)
    top = head + gap
    for r, row in enumerate(images):
        if row_labels:
            _write(sheet, row_labels[r], gap, top + above)
        for left, image in zip(lefts, row, strict=False):
            sheet[top + above : top + above + image.shape[0], left : left + image.shape[1]] = image
        top += above + heights[r] + gap
    return sheet


def map_sheet(
    maps: Mapping[str, np.ndarray],
    mask: np.ndarray,
    views: Sequence[str],
    *,
    frames: Sequence[int],
    numbers: Sequence[int] | None = None,
    title: str = "",
) -> np.ndarray:
    """Encoded maps of some frames: a row a frame, a column a kind of map and view, background white.

    Args:
        maps: name to maps (T, S, H, W, 3) in [0, 1]; all alike in shape.
        mask: (S, H, W) bool.
        views: S names.
        frames: which of the T frames to show.
        numbers: what these frames are called, if not by their places.
        title: text above everything.

    Returns:
        (H', W', 3) uint8, RGB.
    """
    rows = [
        [
            np.where(mask[s, ..., None], image[frame, s], 1.0)
            for image in maps.values()
            for s in range(len(views))
        ]
        for frame in frames
    ]
    columns = [f"{name}, {view}" for name in maps for view in views]
    return contact_sheet(
        rows,
        row_labels=[f"frame {number}" for number in numbers or frames],
        column_labels=columns,
        title=title,
    )


def difference_picture(
    first: np.ndarray, second: np.ndarray, mask: np.ndarray, *, unit: str = "", limit: float | None = None
) -> np.ndarray:
    """How far two maps of one view are apart, as colours with a bar that gives their scale.

    Args:
        first, second: (H, W, C); the Euclidean distance along C is shown.
        mask: (H, W) bool; the rest is white.
        unit: what the values are measured in, written at the bar.
        limit: the value of the last colour, larger ones get it too; the 99th percentile if None.

    Returns:
        (H + 44, max(W, 60), 3) uint8, RGB: the picture, and below it the bar from 0 to `limit`.

    Raises:
        InputError: shapes that differ, or an empty mask.
    """
    if first.shape != second.shape or first.shape[:2] != mask.shape or not mask.any():
        raise InputError(
            f"two maps of one shape and their non-empty mask are needed, found {first.shape}, {second.shape} "
            f"and mask {mask.shape} with {int(np.sum(mask))} pixels"
        )
    distance = np.linalg.norm(np.asarray(first, np.float64) - second, axis=-1)
    top = float(np.percentile(distance[mask], 99)) if limit is None else limit
    top = top if top > 0 else 1.0
    picture = heat_colours(distance / top)
    picture[~mask] = _WHITE
    height, width = mask.shape
    whole = np.full((height, max(width, 60), 3), _WHITE, np.uint8)  # the bar's labels need some room
    whole[:, :width] = picture
    return np.concatenate([whole, scale_bar(whole.shape[1], top, unit)])


def scale_bar(width: int, top: float, unit: str = "") -> np.ndarray:
    """(44, width, 3) uint8, width at least 60: `heat_colours` from 0 to `top`, with both ends labelled."""
    bar = np.full((44, width, 3), _WHITE, np.uint8)
    bar[6:20, 4 : width - 4] = heat_colours(np.linspace(0, 1, width - 8))
    label = f"{top:.3g} {unit}".rstrip()
    _write(bar, "0", 4, 20 + _LINE)
    _write(bar, label, max(16, width - 4 - _text_width(label)), 20 + _LINE)
    return bar


def heat_colours(values: np.ndarray) -> np.ndarray:
    """Values (...,) from 0 to 1 (clipped) to colours (..., 3) uint8, RGB, dark to bright."""
    levels = (np.clip(values, 0, 1) * 255).round().astype(np.uint8)
    coloured: np.ndarray = cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_VIRIDIS)
    return coloured.reshape(*levels.shape, 3)[..., ::-1].copy()


def to_uint8(image: np.ndarray) -> np.ndarray:
    """An image (H, W) or (H, W, 3), uint8 or floating point in [0, 1] (clipped), as (H, W, 3) uint8."""
    image = np.asarray(image)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=-1)
    if image.ndim != 3 or image.shape[-1] != 3:
        raise InputError(f"a picture must have shape (H, W) or (H, W, 3), found {image.shape}")
    if image.dtype == np.uint8:
        return image
    pixels: np.ndarray = (np.clip(image, 0, 1) * 255).round().astype(np.uint8)
    return pixels


def write_png(path: Path | str, image: np.ndarray) -> None:
    """Write an image as `to_uint8` takes it; the file appears whole or not at all.

    Raises:
        InputError: the path does not end in .png, or the image has another shape.
    """
    path = Path(path)
    if path.suffix != ".png":
        raise InputError(f"{path}: pictures are written as .png")
    content = png_bytes(image)
    with written_whole(path) as temporary:
        temporary.write_bytes(content)


def png_bytes(image: np.ndarray) -> bytes:
    """An image as `to_uint8` takes it, as the content of a PNG file.

    Raises:
        InputError: another shape.
    """
    pixels = np.ascontiguousarray(to_uint8(image)[..., ::-1])
    content: bytes = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    return content


def _text_width(text: str) -> int:
    return int(cv2.getTextSize(text, _FONT, _FONT_SCALE, 1)[0][0])


def _write(image: np.ndarray, text: str, left: int, bottom: int) -> None:
    """Draw one line of text into `image`, in the 20 rows that end at `bottom`."""
    cv2.putText(image, text, (left, bottom - 6), _FONT, _FONT_SCALE, _BLACK, 1, cv2.LINE_AA)
