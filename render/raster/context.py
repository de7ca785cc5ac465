"""GL contexts without a display: who opens one, with what, and who closes it."""

from __future__ import annotations

import importlib
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

GL_BACKENDS = ("egl", "osmesa")
HOW_TO_INSTALL = {"egl": "apt-get install libegl1 libgl1-mesa-dri", "osmesa": "apt-get install libosmesa6"}


# The process that first opened a context, if any. Drivers keep threads and locks of their own from then on, and a
# fork copies the locks but not the threads: a child that uses its copy of the driver waits for ever.
_opened_by: int | None = None
_open = threading.local()  # .contexts: those that this thread has open, the last one current


class GLUnavailableError(RuntimeError):
    """No GL context can be opened on this machine with the backend asked for.

    Args:
        message: the backend, and what it says.
        remedy: what to do about it; by default to install the backend.
    """

    def __init__(self, message: str, remedy: str | None = None) -> None:
        super().__init__(message)
        backend = message.partition(":")[0]
        self.remedy = remedy or f"run: {HOW_TO_INSTALL.get(backend, HOW_TO_INSTALL['egl'])}"


@dataclass(frozen=True)
class GLContext:
    """An open context: the backend's name, moderngl's context and the driver's name of itself."""

    backend: str
    gl: Any
    renderer: str


@contextmanager
def open_context(backend: str) -> Iterator[GLContext]:
    """Open a standalone OpenGL 3.3 context for the length of a `with` block; it is released however the block ends.

    It is current in the block. Where blocks of one thread lie in one another, the outer one's is again afterwards.

    Triton is imported first where it is installed. Mesa's software renderer and triton each bring an LLVM,
    and the process dies if triton's is loaded after Mesa's has started (any CUDA build of torch imports
    triton lazily); the other order is safe. This is the only place of the project that opens contexts.

    A process that was forked from one that has opened a context gets none, as its driver would hang; and what it
    inherits of an open context is left alone.

    Args:
        backend: "egl" or "osmesa".

    Raises:
        GLUnavailableError: the backend is missing, gives no OpenGL 3.3, or was used before this process was forked.
    """
    global _opened_by  # noqa: PLW0603 - drivers have one state a process
    if _opened_by not in (None, os.getpid()):
        raise GLUnavailableError(
            f"{backend}: used before this process was forked, after which drivers hang",
            "start the workers before anything is drawn, or by the method 'spawn' or 'forkserver'",
        )
    _import_triton()
    import moderngl  # noqa: PLC0415  (so that `import render` works where GL does not)

    from render.raster.osmesa import OSMesaContext  # noqa: PLC0415

    if backend not in GL_BACKENDS:
        raise ValueError(f"backend must be one of {GL_BACKENDS}, found {backend!r}")
    try:
        _opened_by = os.getpid()
        source = {"backend": "egl"} if backend == "egl" else {"context": OSMesaContext()}
        gl = moderngl.create_context(standalone=True, require=330, **source)
    except Exception as error:  # glcontext raises bare Exception
        raise GLUnavailableError(f"{backend}: {error}") from error
    open_here = _open.__dict__.setdefault("contexts", [])
    open_here.append(gl)
    try:
        gl.__enter__()  # current from here on
        yield GLContext(backend, gl, gl.info["GL_RENDERER"])
    finally:
        if os.getpid() == _opened_by:  # a forked child leaves its parent's context alone
            open_here.remove(gl)
            gl.__exit__(None, None, None)
            gl.release()
            if open_here:
                open_here[-1].__enter__()  # drivers know one current context only


def probe_backends() -> dict[str, str]:
    """What each GL backend says on this machine: the renderer's name, or "unavailable: " and why not."""
    answers = {}
    for backend in GL_BACKENDS:
        try:
            with open_context(backend) as context:
                answers[backend] = context.renderer
        except GLUnavailableError as error:
            answers[backend] = f"unavailable: {error}"
    return answers


def _import_triton() -> None:
    try:
        importlib.import_module("triton")
    except ImportError:
        return  # a CPU build of torch has none
