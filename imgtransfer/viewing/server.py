"""Where the page is served: on one port of this machine, without a word to anywhere else."""

from __future__ import annotations

import contextlib
import errno
import io
import ipaddress
import logging
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from render import InputError, Option
from render.extras import optional

if TYPE_CHECKING:  # a package of an extra
    from viser import ViserServer

_log = logging.getLogger(__name__)

PORT = 8080
_TITLE = "imgtransfer view"


@contextmanager
def page_server(host: str, port: int) -> Iterator[ViserServer]:
    """Serve an empty page while the block runs.

    Args:
        host: a name or address of this machine.
        port: 0 takes any that is free.

    Raises:
        InputError: viser is missing; the host is none of this machine's; the port is in use, or not allowed.
    """
    viser = optional("viser", "view", "`imgtransfer view`")
    _check_free(host, port)
    if not is_loopback(host):
        _log.warning(
            "note: there is no password: whoever reaches %s can look at this page, and change what it shows",
            host,
        )
    with _quiet():
        server: ViserServer = viser.ViserServer(host=host, port=port, label=_TITLE, verbose=False)
    try:
        if port not in (0, server.get_port()):  # somebody was quicker; viser then takes the next
            raise _in_use(host, port)
        # Any page in any browser on this machine may talk to a server on it, and ask viser to be put on the internet.
        server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        yield server
    finally:
        with _quiet():
            server.stop()


def address_of(server: ViserServer) -> str:
    """What to open in a browser on this machine."""
    host = server.get_host()
    if host in ("0.0.0.0", "::", ""):
        host = "127.0.0.1"
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def open_browser(address: str) -> None:
    """Open an address in the user's browser, where there is a screen for it; nothing is waited for."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return  # what would be opened is a browser for terminals, in the one that the command runs in
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach it."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _check_free(host: str, port: int) -> None:
    """Raise InputError unless a server can listen there; viser would take another port, or wait for ever."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (socket.gaierror, UnicodeError) as error:
        raise InputError(
            f"{Option('host')} {host!r}: no such host; 127.0.0.1 is this machine's own"
        ) from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise _in_use(host, port) from error
        if error.errno == errno.EADDRNOTAVAIL:
            raise InputError(
                f"{Option('host')} {host}: is not an address of this machine; 127.0.0.1 is its own, 0.0.0.0 all of them"
            ) from error
        reason = error.strerror or str(error)
        raise InputError(
            f"{Option('port')} {port}: cannot be listened on ({reason}); take another"
        ) from error


def _in_use(host: str, port: int) -> InputError:
    return InputError(
        f"{Option('port')} {port}: is in use on {host}, perhaps by another page; give another, or 0 for a free one"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """In here, what viser prints of itself goes nowhere."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
