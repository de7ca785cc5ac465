"""A dressed body in the page's scene: meshes whose vertices are replaced in place, marks, and maps beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imgtransfer.viewing.colours import LEVEL_COLOURS, UNITS, levels
from imgtransfer.viewing.frame import Frame, Motion
from imgtransfer.viewing.look import Look
from imgtransfer.viewing.map_wall import MapWall
from imgtransfer.viewing.picking import Mark, Ray, first_hit

if TYPE_CHECKING:  # a package of an extra
    from viser import LineSegmentsHandle, MeshHandle, SceneApi

SKIN, CLOTH = (222, 199, 181), (92, 140, 204)
_THROUGH_BODY, _THROUGH_ITSELF, _MARK = (230, 40, 40), (255, 150, 0), (255, 0, 160)
_LINE_PIXELS = 4.0
_MARK_RADIUS = 0.009  # metres
_TITLE_HEIGHT = 0.12  # metres above the body's first frame
_GAP = 0.1  # metres beside it


@dataclass(frozen=True)
class Facts:
    """What is said of a figure's frame, beside what is seen.

    Args:
        title: the figure's.
        mean: of what the colours stand for, with its unit; None where they stand for nothing.
        crossings: edges through the other of garment and body, and of the garment through itself; None if not asked.
        place: the marked point, metres, world; None where nothing is marked.
        error: the marked point's distance to the truth, millimetres; None where that is not known.
        pixels: which pixel of which view shows the marked point.
    """

    title: str
    mean: tuple[float, str] | None
    crossings: tuple[int, int] | None
    place: np.ndarray | None
    error: float | None
    pixels: tuple[tuple[str, int, int], ...]


class Figure:
    """A motion's garment and body, drawn at a place of its own.

    Args:
        scene: of the page.
        name: of the figure's nodes, as a path in the scene.
        motion: what moves.
        pointed: called, by threads of the server, with the ray to where a map is pointed at.

    Attributes:
        bottom, top: heights, metres, of the body's first frame, with the title.

    Raises:
        InputError: the first frame cannot be read.
    """

    def __init__(self, scene: SceneApi, name: str, motion: Motion, pointed: Callable[[Ray], None]) -> None:
        self._scene, self._name, self.motion, self._offset = scene, name, motion, np.zeros(3)
        dress, body = motion.dress, motion.frame(0).body
        self.bottom, self.top = float(body[:, 1].min()), float(body[:, 1].max()) + _TITLE_HEIGHT
        self._root = scene.add_frame(name, show_axes=False)
        scene.add_label(f"{name}/title", motion.title, position=(0.0, self.top, 0.0), anchor="bottom-center")
        self._body = self._mesh("body", dress.body.vertices, dress.body.faces, SKIN)
        self._cloth = self._mesh("cloth", dress.rest.vertices, dress.rest.faces, CLOTH)
        self._levels: dict[int, MeshHandle] = {}
        self._lines: dict[str, LineSegmentsHandle] = {}
        self._ball = scene.add_icosphere(
            f"{name}/mark", radius=_MARK_RADIUS, color=_MARK, visible=False, cast_shadow=False
        )
        self._wall = MapWall(scene, f"{name}/maps", dress, self.bottom, pointed)
        self._shown: tuple[np.ndarray, np.ndarray] | None = None  # the garment, and what it was moved by

    @property
    def half_width(self) -> float:
        """Metres from its middle to its left end."""
        return float(np.abs(self.motion.dress.body.vertices[:, 0]).max()) + _GAP

    def width(self, *, maps: bool) -> float:
        """Metres from its left end to its right, with or without the maps."""
        right = max(self.half_width, self._wall.right) if maps else self.half_width
        return self.half_width + right

    def put(self, offset: np.ndarray) -> None:
        """Move its origin to a place (3,) in the scene, metres."""
        self._offset = offset
        self._root.position = offset

    def remove(self) -> None:
        """Take it out of the scene, with all that belongs to it."""
        self._root.remove()

    def draw(self, frame: Frame, look: Look) -> Facts:
        """Show a frame."""
        moved = _in_place(frame.body) if look.in_place else np.zeros(3)
        self._body.vertices = frame.body - moved
        values = self.motion.dress.values(frame, look.colours)
        self._draw_cloth(None if frame.garment is None else frame.garment - moved, values, look.limit)
        crossings = self._draw_crossings(frame, moved) if look.crossings else None
        if crossings is None:
            for handle in self._lines.values():
                handle.visible = False
        mark = look.mark
        if mark is not None and mark.face >= len(self.motion.dress.rest.faces):
            mark = None  # of a garment with more faces
        place = self._draw_mark(mark, frame, moved)
        pixels = self._wall.draw(frame, look.maps, mark)
        self._shown = None if frame.garment is None else (frame.garment, moved)
        mean = None if values is None else (float(values.mean()), UNITS[look.colours])
        error = None
        if mark is not None and place is not None and frame.truth is not None:
            error = 1000 * float(
                np.linalg.norm(place - mark.place(frame.truth, self.motion.dress.rest.faces))
            )
        return Facts(self.motion.title, mean, crossings, place, error, pixels)

    def picked(self, ray: Ray) -> tuple[float, Mark | None] | None:
        """What a ray meets first of the garment as it is shown and its maps, and how far along; None for nothing.

        A map's background is met, too, and marks nothing.
        """
        local = ray.moved(self._offset)
        hits: list[tuple[float, Mark | None]] = []
        if self._shown is not None:
            vertices, moved = self._shown
            if hit := first_hit(local, vertices - moved, self.motion.dress.rest.faces):
                hits.append(hit)
        if on_map := self._wall.picked(local):
            hits.append(on_map)
        return min(hits, key=lambda hit: hit[0], default=None)

    def _mesh(
        self, name: str, vertices: np.ndarray, faces: np.ndarray, colour: tuple[int, int, int]
    ) -> MeshHandle:
        # viser's vertices and faces may be replaced, so that nothing is added or removed as frames go by.
        return self._scene.add_mesh_simple(
            f"{self._name}/{name}",
            vertices.astype(np.float32),
            faces.astype(np.uint32),
            color=colour,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _draw_cloth(self, garment: np.ndarray | None, values: np.ndarray | None, limit: float) -> None:
        self._cloth.visible = garment is not None and values is None
        of_face = None if values is None or garment is None else levels(values, limit)
        if garment is not None and of_face is None:
            self._cloth.vertices = garment
        present = set() if of_face is None else set(np.unique(of_face).tolist())
        for level, handle in self._levels.items():
            handle.visible = level in present
        if garment is None or of_face is None:
            return
        for level in present:
            chosen = self.motion.dress.rest.faces[of_face == level]
            used, corners = np.unique(chosen, return_inverse=True)
            vertices, faces = garment[used].astype(np.float32), corners.reshape(-1, 3).astype(np.uint32)
            if level not in self._levels:
                red, green, blue = LEVEL_COLOURS[level].tolist()
                self._levels[level] = self._mesh(f"level{level}", vertices, faces, (red, green, blue))
            else:
                self._levels[level].vertices, self._levels[level].faces = vertices, faces

    def _draw_crossings(self, frame: Frame, moved: np.ndarray) -> tuple[int, int]:
        through, itself = self.motion.dress.crossing_edges(frame)
        self._draw_lines("through", through - moved, _THROUGH_BODY)
        self._draw_lines("itself", itself - moved, _THROUGH_ITSELF)
        return len(through), len(itself)

    def _draw_lines(self, name: str, ends: np.ndarray, colour: tuple[int, int, int]) -> None:
        if name in self._lines:
            self._lines[name].visible = len(ends) > 0
            if len(ends):
                self._lines[name].points = ends.astype(np.float32)
        elif len(ends):
            self._lines[name] = self._scene.add_line_segments(
                f"{self._name}/{name}",
                ends.astype(np.float32),
                colour,
                thickness=_LINE_PIXELS,
                thickness_units="screen",
            )

    def _draw_mark(self, mark: Mark | None, frame: Frame, moved: np.ndarray) -> np.ndarray | None:
        self._ball.visible = mark is not None and frame.garment is not None
        if mark is None or frame.garment is None:
            return None
        place = mark.place(frame.garment, self.motion.dress.rest.faces)
        self._ball.position = place - moved
        return place


def _in_place(body: np.ndarray) -> np.ndarray:
    """(3,) metres over the floor, from the origin to the middle of a body."""
    middle = body.mean(axis=0)
    middle[1] = 0
    return middle
