"""Where pages look from: all of the scene at first, and from one place where they are linked."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:  # a package of an extra
    from viser import CameraHandle, ClientHandle, ViserServer

_FOV = 0.75  # radians, from top to bottom
_UP = (0.0, 1.0, 0.0)
_AROUND = 1.1  # of what is to be seen
_LANDSCAPE = 1.35  # width by height of what a page shows beside its controls
_SAME = 1e-3  # of the distance to what is looked at
# A page that was told where to look from reports places on its way there, each as late as the browser draws. One that
# has not arrived by then never will, and leads again.
_ARRIVES_S = 30.0


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a page looks from, (3,) metres, to what, (3,), and which way is up on it, (3,)."""

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray

    @staticmethod
    def of(camera: CameraHandle) -> _Place:
        """A page's as it reported it last, or was told since."""
        return _Place(*(np.array(one) for one in (camera.position, camera.look_at, camera.up_direction)))

    def like(self, other: _Place) -> bool:
        """Whether nobody sees a difference."""
        away = max(np.linalg.norm(self.eye - other.eye), np.linalg.norm(self.target - other.target))
        return bool(away <= _SAME * np.linalg.norm(self.eye - self.target))


class Cameras:
    """The cameras of all pages that are open. What stands side by side is one scene, and has one camera by nature.

    Args:
        server: of the pages. linked: the control that says whether pages shall look from the same place.
    """

    def __init__(self, server: ViserServer, linked: Any) -> None:
        self._server, self._linked = server, linked
        # By page: what it was told and has not reported yet, and since when.
        self._told: dict[int, tuple[_Place, float]] = {}
        self._lock = threading.Lock()
        server.initial_camera.fov, server.initial_camera.up = _FOV, _UP
        self._framed = (0.0, 0.0, 0.0)
        server.on_client_connect(self._welcome)
        server.on_client_disconnect(self._forget)
        linked.on_update(self._link)

    def frame(self, width: float, bottom: float, top: float) -> None:
        """Let all pages look from the front at something that is new, and so pages that are opened later.

        Args:
            width: metres around the origin. bottom, top: heights, metres.
        """
        if (width, bottom, top) == self._framed:
            return
        self._framed, middle = (width, bottom, top), (bottom + top) / 2
        distance = _AROUND * max((top - bottom) / 2, width / _LANDSCAPE / 2) / np.tan(_FOV / 2)
        eye, target = (0.0, middle + 0.1 * distance, distance), (0.0, middle, 0.0)
        self._server.initial_camera.position, self._server.initial_camera.look_at = eye, target
        place = _Place(np.array(eye), np.array(target), np.array(_UP))
        with self._lock:
            for client in self._server.get_clients().values():
                self._tell(client, place)

    def _welcome(self, client: ClientHandle) -> None:
        """Watch a new page, and let it look from where linked ones do already."""

        async def moved(
            camera: CameraHandle,
        ) -> None:  # not a thread's, which would see some reports late or never
            self._moved(camera)

        client.camera.on_update(moved)
        others = self._others(client)
        if self._linked.value and others:
            with self._lock:
                self._tell(client, self._going_to(others[0]))

    def _forget(self, client: ClientHandle) -> None:
        self._told.pop(client.client_id, None)

    def _link(self, event: Any) -> None:
        """Let the others follow the page on which somebody has linked them."""
        if event.client is not None:
            self._moved(event.client.camera)

    def _moved(self, camera: CameraHandle) -> None:
        """Let the other pages follow one that somebody has moved, and not one that follows."""
        if not self._linked.value:
            return
        number, place = camera.client.client_id, _Place.of(camera)
        with self._lock:
            told, since = self._told.get(number, (None, 0.0))
            if told is not None and not told.like(place) and time.monotonic() - since < _ARRIVES_S:
                return
            self._told.pop(number, None)
            if told is not None and told.like(place):
                return
            for client in self._others(camera.client):
                self._tell(client, place)

    def _tell(self, client: ClientHandle, place: _Place) -> None:
        """Let a page look from a place, unless it does so already or is on its way there."""
        if self._going_to(client).like(place):
            return
        self._told[client.client_id] = place, time.monotonic()
        client.camera.up_direction = place.up
        client.camera.position, client.camera.look_at = place.eye, place.target

    def _going_to(self, client: ClientHandle) -> _Place:
        told, _ = self._told.get(client.client_id, (None, 0.0))
        return _Place.of(client.camera) if told is None else told

    def _others(self, client: ClientHandle) -> list[ClientHandle]:
        clients = self._server.get_clients().items()
        return [other for number, other in clients if number != client.client_id]
