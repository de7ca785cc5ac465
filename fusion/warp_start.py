"""Starting Warp late and quietly."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

_building = Lock()
_built: set[tuple[Any, str]] = set()  # kernels that have been launched, and where


@cache
def warp_module() -> Any:
    """The warp module, started without its banner; imported late, because that takes a second."""
    import warp  # noqa: PLC0415

    if hasattr(warp, "LOG_WARNING"):
        warp.config.log_level = warp.LOG_WARNING
    else:  # older versions
        setattr(warp.config, "quiet", True)  # noqa: B010 (the type checker knows only the newer versions)
    with _without_driver_warning():
        warp.init()  # type: ignore[no-untyped-call]
    return warp


def launch(kernel: Any, **arguments: Any) -> Any:
    """`warp.launch`, the first of each kernel and device by itself.

    The first builds the kernel's module, which Warp must not do in two threads at once.
    """
    key = kernel, str(arguments["device"])
    if key in _built:
        return warp_module().launch(kernel, **arguments)
    with _building:
        launched = warp_module().launch(kernel, **arguments)
        _built.add(key)
    return launched


@contextmanager
def _without_driver_warning() -> Iterator[None]:
    """Keep back the one line that Warp's C++ start-up writes to stderr on every machine without a GPU driver.

    No setting of Warp's silences it. Whatever else is written meanwhile is passed on.
    """
    sys.stderr.flush()
    keep = os.dup(2)
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(keep, 2)
            os.close(keep)
            caught.seek(0)
            lines = [line for line in caught if b"load the NVIDIA CUDA driver" not in line]
            os.write(2, b"".join(lines))
