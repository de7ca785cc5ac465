"""Packages that only some commands need, and that come with the extras of imgtransfer."""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import Any

from render.errors import InputError


def optional(package: str, extra: str, purpose: str) -> Any:
    """Import a package of the extra `extra`.

    Raises:
        InputError: it is not installed, or cannot be loaded; the message names what needs it, and the extra.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        broken = "" if _missing(package) else f" (it is there, but: {' '.join(str(error).split())})"
        raise InputError(_wanted(package, extra, purpose) + broken) from error


def check_installed(extra: str, purpose: str, *packages: str) -> None:
    """Raise `optional`'s InputError where one of the packages is missing, without the time to import them."""
    for package in packages:
        if _missing(package):
            raise InputError(_wanted(package, extra, purpose))


def _missing(package: str) -> bool:
    try:
        return find_spec(package) is None
    except ValueError:  # a module without a spec, which is there
        return False


def _wanted(package: str, extra: str, purpose: str) -> str:
    return f"{purpose} needs the package {package}: pip install 'imgtransfer[{extra}]'"
