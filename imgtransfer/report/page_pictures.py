"""Pictures inside a page, at most 3 MB of them: made smaller together, or counted one after another."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import cv2
import numpy as np

PICTURE_BYTES = 3_000_000  # of all pictures of a page, as they stand in it
_SLACK = 0.97  # a picture's bytes fall a little more slowly than its pixels
_WEBP_SIDE = 16383  # pixels, more than which the format cannot have
_QUALITY: dict[str, int] = {"jpeg": cv2.IMWRITE_JPEG_QUALITY, "webp": cv2.IMWRITE_WEBP_QUALITY}


def data_uri(kind: str, image: np.ndarray, quality: int = 85) -> str:
    """An image (H, W, 3) uint8 RGB inside a URI.

    Args:
        kind: "png", "webp" or "jpeg", of which only the first keeps all. Too long a picture for WebP becomes a JPEG.
        quality: of the other two, up to 100.
    """
    if kind == "webp" and max(image.shape[:2]) > _WEBP_SIDE:
        kind = "jpeg"
    options = [_QUALITY[kind], quality] if kind in _QUALITY else []
    data = cv2.imencode(f".{kind}", np.ascontiguousarray(image[..., ::-1]), options)[1]
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"


class PictureBudget:
    """What is left for pictures on a page.

    Args:
        limit: bytes of all pictures together.
    """

    def __init__(self, limit: int = PICTURE_BYTES) -> None:
        self._left = limit

    def take(self, *sources: str) -> bool:
        """Whether these URIs fit together; they then count, otherwise none does."""
        size = sum(map(len, sources))
        if size > self._left:
            return False
        self._left -= size
        return True


def fitting_uris(
    images: Sequence[np.ndarray], kinds: Sequence[str], *, limit: int = PICTURE_BYTES
) -> tuple[list[str], float]:
    """Images as URIs that fit a page together.

    Args:
        images: (H, W, 3) uint8 RGB each.
        kinds: as for `data_uri`, from the best to the smallest; the first one that fits is taken.
        limit: bytes of all together.

    Returns:
        The URIs, and the factor by which all sides were made smaller, where even the last kind is too large; else 1.
    """
    for kind in kinds:
        sources = [data_uri(kind, image) for image in images]
        if (size := sum(map(len, sources))) <= limit:
            return sources, 1.0
    factor = 1.0
    while size > limit and any(max(_size(image, factor)) > 1 for image in images):
        factor *= _SLACK * (limit / size) ** 0.5
        sources = [data_uri(kinds[-1], _smaller(image, factor)) for image in images]
        size = sum(map(len, sources))
    return sources, factor


def _size(image: np.ndarray, factor: float) -> tuple[int, int]:
    """(width, height) in pixels."""
    return max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor))


def _smaller(image: np.ndarray, factor: float) -> np.ndarray:
    return cv2.resize(image, _size(image, factor), interpolation=cv2.INTER_AREA)
