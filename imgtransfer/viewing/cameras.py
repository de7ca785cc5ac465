"""Where pages look from: all of the scene at first, and from one place where they are linked."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # a package of an extra
    from viser import CameraHandle, ClientHandle, ViserServer

_FOV = 0.75  # radians, from top to bottom
_AROUND = 1.1  # of what is to be seen
_LANDSCAPE = 1.35  # width by height of what a page shows beside its controls
_FOLLOWS_S = 0.4  # a page whose camera was moved for it reports that, and is not followed in turn


class Cameras:
    """The cameras of all pages that are open. What stands side by side is one scene, and has one camera by nature.

    Args:
        server: of the pages. linked: whether pages shall look from the same place.
    """

    def __init__(self, server: ViserServer, linked: Callable[[], bool]) -> None:
        self._server, self._linked = server, linked
        self._followed: dict[int, float] = {}  # when a page's camera was moved for it
        server.initial_camera.fov = _FOV
        server.initial_camera.up = (0.0, 1.0, 0.0)
        self._framed = (0.0, 0.0, 0.0)
        server.on_client_connect(self._watch)

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
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = eye, target

    def _watch(self, client: ClientHandle) -> None:
        client.camera.on_update(self._lead)

    def _lead(self, camera: CameraHandle) -> None:
        """Let the other pages follow."""
        now = time.monotonic()
        if not self._linked() or now - self._followed.get(camera.client.client_id, 0.0) < _FOLLOWS_S:
            return
        for number, client in self._server.get_clients().items():
            if number != camera.client.client_id:
                self._followed[number] = now
                client.camera.up_direction = camera.up_direction
                client.camera.position, client.camera.look_at = camera.position, camera.look_at
