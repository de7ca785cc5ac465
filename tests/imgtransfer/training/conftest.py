"""Fixtures of the tests of training."""

from __future__ import annotations

from pathlib import Path

import pytest

from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.training.config import RunConfig
from tests.helpers.training import small_config


@pytest.fixture(scope="module")
def source(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two clip npz files."""
    folder = tmp_path_factory.mktemp("clips")
    save_clip(folder / "first.npz", tube_clip)
    save_clip(folder / "second_test.npz", tube_clip.slice(slice(2, 5)))
    return folder


@pytest.fixture
def config(source: Path) -> RunConfig:
    """`small_config` of these clips."""
    return small_config(source)
