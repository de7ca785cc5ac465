"""Makes the helper modules that stand beside the tests importable, and knows systems without OSMesa."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from render.raster.context import probe_backends


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip OSMesa's tests where the distribution has none (Mesa 25.1 and later), and only there."""
    of_osmesa = [item for item in items if _needs_osmesa(item)]
    if of_osmesa and probe_backends()["osmesa"].startswith("unavailable") and not _distribution_has_osmesa():
        for item in of_osmesa:
            item.add_marker(pytest.mark.skip(reason="this distribution's Mesa has no OSMesa any more"))


def _needs_osmesa(item: pytest.Item) -> bool:
    parameters = (
        item.callspec.params if isinstance(item, pytest.Function) and hasattr(item, "callspec") else {}
    )
    named = any(isinstance(value, str) and value == "osmesa" for value in parameters.values())
    return named or item.get_closest_marker("osmesa") is not None


def _distribution_has_osmesa() -> bool:
    if shutil.which("apt-cache") is None:
        return False
    return (
        subprocess.run(["apt-cache", "show", "libosmesa6"], capture_output=True, check=False).returncode == 0
    )
