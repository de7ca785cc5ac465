"""What Blender wrote, once for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.blender.blender_python import run_blender


@pytest.fixture(scope="session")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `write_cases`: one file a case, and truth.npz."""
    folder = tmp_path_factory.mktemp("blender")
    run_blender(Path(__file__).with_name("write_cases.py"), folder)
    return folder
