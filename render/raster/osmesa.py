"""A GL context from libOSMesa, in the form that moderngl takes.

moderngl opens contexts through glcontext, which no longer knows OSMesa; it also accepts any object with
`load`, `__enter__`, `__exit__` and `release`, which is what stands here.
"""

from __future__ import annotations

import ctypes
import functools
import subprocess
import sys
from typing import Any

# What `_crash` runs; without this folder in Python's path, whose operator.py would hide Python's own.
_TRIAL = ("-P", __file__)
_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
# GL/osmesa.h and GL/gl.h
_FORMAT, _RGBA, _UNSIGNED_BYTE = 0x22, 0x1908, 0x1401
_PROFILE, _CORE_PROFILE, _MAJOR_VERSION, _MINOR_VERSION = 0x33, 0x34, 0x36, 0x37


class OSMesaContext:
    """A standalone OpenGL 3.3 core context in main memory.

    Raises:
        OSError: libOSMesa is not installed, or makes no OpenGL 3.3 context.
    """

    def __init__(self) -> None:
        self._library = _open_library()
        fault = _crash()
        if fault:
            raise OSError(fault)
        attributes = (_FORMAT, _RGBA, _PROFILE, _CORE_PROFILE, _MAJOR_VERSION, 3, _MINOR_VERSION, 3, 0, 0)
        self._handle = self._library.OSMesaCreateContextAttribs(
            (ctypes.c_int * len(attributes))(*attributes), None
        )
        if not self._handle:
            raise OSError("libOSMesa makes no OpenGL 3.3 core context")
        self._screen = (ctypes.c_ubyte * 4)()  # OSMesa wants a default framebuffer; we draw into our own
        self.__enter__()  # moderngl asks for the version at once, without entering

    def load(self, name: str) -> int:
        """Address of a GL function, 0 if there is none (called by moderngl)."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load_opengl_function = load  # what older moderngl calls it

    def __enter__(self) -> None:
        if not self._library.OSMesaMakeCurrent(self._handle, self._screen, _UNSIGNED_BYTE, 1, 1):
            raise OSError("libOSMesa cannot make its context current")

    def __exit__(self, *error: object) -> None:
        self._library.OSMesaMakeCurrent(None, None, 0, 0, 0)

    def release(self) -> None:
        """Free the context; a second call does nothing."""
        if self._handle:
            self._library.OSMesaMakeCurrent(None, None, 0, 0, 0)
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = None


@functools.cache
def _crash() -> str | None:
    """What to say if libOSMesa kills the process that asks it for a context, as it does with some broken set-ups of
    Mesa; tried once, in a process of its own.
    """
    if __name__ == "__main__" or not sys.executable:
        return None
    tried = subprocess.run([sys.executable, *_TRIAL], capture_output=True, check=False)
    return f"libOSMesa crashes (signal {-tried.returncode})" if tried.returncode < 0 else None


def _open_library() -> Any:
    for name in _LIBRARIES:
        try:
            library = ctypes.CDLL(name)
        except OSError:
            continue
        library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        library.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_void_p] + [ctypes.c_int] * 3
        library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        library.OSMesaDestroyContext.restype = None
        return library
    raise OSError(f"none of {', '.join(_LIBRARIES)} is installed")


if __name__ == "__main__":  # what _crash tries
    OSMesaContext().release()
