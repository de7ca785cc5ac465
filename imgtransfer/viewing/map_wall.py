"""A figure's maps, as pictures that stand beside it in the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from imgtransfer.viewing.frame import Dress, Frame
from imgtransfer.viewing.look import Maps
from imgtransfer.viewing.picking import Mark, Pixels, Ray, on_picture

if TYPE_CHECKING:  # a package of an extra
    from viser import ImageHandle, SceneApi, SceneNodeDragEvent

WIDTH = 0.8  # metres of a picture
_ABOVE_EACH_OTHER = 2  # pictures
LEFT = 0.75  # metres from the figure's middle to the pictures' edge
_GAP = 0.05
_CROSS = (255, 0, 160)
_UPRIGHT = (0.0, 1.0, 0.0, 0.0)  # viser's pictures have y down and look along +z; turned about x they face +z


class MapWall:
    """Pictures of the maps, a view each, to the right of a figure.

    Args:
        scene: of the page.
        name: of the pictures' nodes.
        dress: what the maps are of.
        bottom: height of the lowest ones, metres.
        pointed: called, by threads of the server, with the ray to where one of them is pointed at with a button held.
    """

    def __init__(
        self, scene: SceneApi, name: str, dress: Dress, bottom: float, pointed: Callable[[Ray], None]
    ) -> None:
        self._scene, self._name, self._dress, self._bottom = scene, name, dress, bottom
        self._pointed = pointed
        self._handles: list[ImageHandle] = []
        self._sizes: list[tuple[int, int]] = []
        self._pixels: Pixels | None = None

    @property
    def right(self) -> float:
        """Metres from the figure's middle to the right edge of the pictures."""
        imager = self._dress.imager()
        columns = 0 if imager is None else -(-len(imager.cameras) // _ABOVE_EACH_OTHER)
        return LEFT + columns * (WIDTH + _GAP) + _GAP

    def draw(self, frame: Frame, kind: Maps, mark: Mark | None) -> tuple[tuple[str, int, int], ...]:
        """Show a frame's maps, with a cross at the pixels that show the marked point; returns view, row and column."""
        maps = None if kind == "none" else frame.maps()
        pictures = [] if maps is None else maps.pictures(kind)
        crossed = []
        if maps is not None and pictures and mark is not None:
            for view, picture in enumerate(pictures):
                if pixel := self._of_template().pixel(view, mark):
                    _cross(picture, *pixel)
                    crossed.append((maps.views[view], *pixel))
        for number, picture in enumerate(pictures):
            self._show(number, picture)
        for handle in self._handles[len(pictures) :]:
            handle.visible = False
        self._sizes = [(picture.shape[0], picture.shape[1]) for picture in pictures]
        return tuple(crossed)

    def picked(self, ray: Ray) -> tuple[float, Mark | None] | None:
        """How far along a ray a picture is met, and the point of the garment there, None in the background."""
        for view, size in enumerate(self._sizes):
            if hit := on_picture(ray, self._centre(view, size), WIDTH, _height(size), size):
                distance, (row, column) = hit
                return distance, self._of_template().mark(view, row, column)
        return None

    def _of_template(self) -> Pixels:
        if self._pixels is None:
            imager = self._dress.imager()
            assert imager is not None  # there are maps
            self._pixels = Pixels(imager)
        return self._pixels

    def _show(self, number: int, picture: np.ndarray) -> None:
        if number < len(self._handles):
            self._handles[number].image = picture
            self._handles[number].visible = True
            return
        size = picture.shape[0], picture.shape[1]
        handle = self._scene.add_image(
            f"{self._name}/{number}",
            picture,
            WIDTH,
            _height(size),
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            wxyz=_UPRIGHT,
            position=self._centre(number, size),
        )
        handle.on_drag("left")(self._dragged)
        self._handles.append(handle)

    def _dragged(self, event: SceneNodeDragEvent[ImageHandle]) -> None:
        # viser tells of no mouse that only moves; of one that drags it does, some 20 times a second.
        eye = np.asarray(event.client.camera.position, np.float64)
        self._pointed(Ray(eye, np.asarray(event.end_position, np.float64) - eye))

    def _centre(self, number: int, size: tuple[int, int]) -> np.ndarray:
        """(3,) metres, of a view's picture, seen from the figure: two above each other, then further to the right."""
        column, row = divmod(number, _ABOVE_EACH_OTHER)
        across = LEFT + WIDTH / 2 + column * (WIDTH + _GAP)
        above = (_ABOVE_EACH_OTHER - 1 - row + 0.5) * (_height(size) + _GAP)
        return np.array([across, self._bottom + above, 0.0])


def _height(size: tuple[int, int]) -> float:
    return WIDTH * size[0] / size[1]


def _cross(picture: np.ndarray, row: int, column: int) -> None:
    """Draw a cross into a picture (H, W, 3) around a pixel, which itself stays to be seen."""
    height, width = picture.shape[:2]
    arm = max(3, height // 24)
    for step in (*range(-arm, 0), *range(1, arm + 1)):
        if 0 <= row + step < height:
            picture[row + step, column] = _CROSS
        if 0 <= column + step < width:
            picture[row, column + step] = _CROSS
