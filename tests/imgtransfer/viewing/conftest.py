"""Data to look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.store import DataSet
from imgtransfer.pipeline.predict import save_prediction
from tests.helpers.models import model_for


@pytest.fixture
def data(tmp_path: Path, tube_clip: Clip) -> Path:
    """tube/a and tube/b, of six frames."""
    stored = DataSet.create(tmp_path / "data.zarr")
    for name in ("a", "b"):
        stored.write(f"tube/{name}", tube_clip, split="test")
    return tmp_path / "data.zarr"


@pytest.fixture
def predictions(tmp_path: Path, tube_clip: Clip, data: Path) -> Path:
    """Of tube/a with maps and a fusion, which is 20 mm off, and of tube/b the vertices alone."""
    assert tube_clip.garment is not None
    folder = tmp_path / "method"
    folder.mkdir()
    save_prediction(folder / "tube__a", model_for(tube_clip), DataSet.open(data).reader("tube/a"), record={})
    save_clip(folder / "tube__b" / "position_only.npz", tube_clip)
    off = tube_clip.with_garment(tube_clip.garment.vertices + np.array([0.0, 0.02, 0.0]))
    save_clip(folder / "tube__a" / "fused.npz", off)
    return folder
