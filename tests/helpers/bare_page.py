"""A page of `imgtransfer view` without a browser: it reports where it looks from, and keeps what it is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec.msgpack
import numpy as np
import viser
import zstandard
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

_HEAD = 16  # bytes, two sizes, before what is packed
_LONGEST_S = 30.0


class BarePage:
    """One open page.

    Attributes:
        told: "position" and "look_at" as the server has set them last, (3,) metres each.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self.told: dict[str, np.ndarray] = {}

    def look(self, eye: tuple[float, float, float], target: tuple[float, float, float] = (0, 1, 0)) -> None:
        """Report a place, as a browser does when its user moves the camera, and when it has done what it was told."""
        self._send(
            _messages.ViewerCameraMessage(
                wxyz=(1.0, 0.0, 0.0, 0.0),
                position=eye,
                fov=0.75,
                near=0.01,
                far=1000.0,
                image_height=200,
                image_width=300,
                look_at=target,
                up_direction=(0.0, 1.0, 0.0),
            )
        )

    def set(self, control: Any, value: object) -> None:
        """Change one of the page's controls, as its user would."""
        self._send(_messages.GuiUpdateMessage(control._impl.uuid, {"value": value}))

    def listen(self) -> None:
        """Keep what comes until the connection ends."""
        while True:
            try:
                content = self._connection.recv()
            except ConnectionClosed:
                return
            assert isinstance(content, bytes)
            size = int.from_bytes(content[8:_HEAD], "little")
            unpacked = zstandard.ZstdDecompressor().decompress(content[_HEAD : _HEAD + size])
            for message in msgspec.msgpack.decode(unpacked)["messages"]:
                for kind, value in (("SetCameraPosition", "position"), ("SetCameraLookAt", "look_at")):
                    if message["type"] == f"{kind}Message" and not message.get("initial"):
                        self.told[value] = np.array(message[value])

    def _send(self, message: Any) -> None:
        self._connection.send(msgspec.msgpack.encode(message.as_serializable_dict()))


@contextmanager
def bare_page(server: viser.ViserServer, eye: tuple[float, float, float]) -> Iterator[BarePage]:
    """Open a page that looks from a place, and wait until the server counts it."""
    before = set(server.get_clients())
    address = f"ws://127.0.0.1:{server.get_port()}"
    protocol: Any = f"viser-v{viser.__version__}"
    with connect(address, subprotocols=[protocol], max_size=None, compression=None) as connection:
        page = BarePage(connection)
        listening = threading.Thread(target=page.listen, daemon=True)
        listening.start()
        page.look(eye)
        wait_until(lambda: bool(set(server.get_clients()) - before))
        # Nobody can click before a page has been welcomed, which another thread does: it then listens to the camera.
        (number,) = set(server.get_clients()) - before
        wait_until(lambda: bool(server.get_clients()[number].camera._state.camera_cb))
        yield page
    listening.join(_LONGEST_S)


def wait_until(reached: Callable[[], bool]) -> None:
    """Wait for something that other threads bring about."""
    end = time.monotonic() + _LONGEST_S
    while not reached():
        assert time.monotonic() < end, "it never came so far"
        time.sleep(0.01)
