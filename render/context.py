"""GL contexts without a display: who opens one, with what, and who closes it."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

GL_BACKENDS = ("egl", "osmesa")
HOW_TO_INSTALL = {"egl": "apt-get install libegl1 libgl1-mesa-dri", "osmesa": "apt-get install libosmesa6"}


class GLUnavailableError(RuntimeError):
    """No GL context can be opened on this machine with the backend asked for."""


@dataclass(frozen=True)
class GLContext:
    """An open context: the backend's name, moderngl's context and the driver's name of itself."""

    backend: str
    gl: Any
    renderer: str


@contextmanager
def open_context(backend: str) -> Iterator[GLContext]:
    """Open a standalone OpenGL 3.3 context for the length of a `with` block; it is released on any way out.

    Triton is imported first where it is installed. Mesa's software renderer and triton each bring an LLVM,
    and the process dies if triton's is loaded after Mesa's has started (any CUDA build of torch imports
    triton lazily); the other order is safe. This is the only place of the project that opens contexts.

    Args:
        backend: "egl" or "osmesa".

    Raises:
        GLUnavailableError: the backend is missing or gives no OpenGL 3.3.
    """
    _import_triton()
    import moderngl  # noqa: PLC0415  (so that `import render` works where GL does not)

    from render.osmesa import OSMesaContext  # noqa: PLC0415

    if backend not in GL_BACKENDS:
        raise ValueError(f"backend must be one of {GL_BACKENDS}, found {backend!r}")
    try:
        source = {"backend": "egl"} if backend == "egl" else {"context": OSMesaContext()}
        gl = moderngl.create_context(standalone=True, require=330, **source)
    except Exception as error:  # glcontext raises bare Exception
        raise GLUnavailableError(f"{backend}: {error}") from error
    try:
        with gl:  # the context is current inside, and whatever was current before is again afterwards
            yield GLContext(backend, gl, gl.info["GL_RENDERER"])
    finally:
        gl.release()


def probe_backends() -> dict[str, str]:
    """What each GL backend says on this machine: the renderer's name, or "unavailable: " and why not."""
    found = {}
    for backend in GL_BACKENDS:
        try:
            with open_context(backend) as context:
                found[backend] = context.renderer
        except GLUnavailableError as error:
            found[backend] = f"unavailable: {error}"
    return found


def _import_triton() -> None:
    try:
        importlib.import_module("triton")
    except ImportError:
        return  # a CPU build of torch has none
