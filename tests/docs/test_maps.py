"""The programs in docs/maps.md do what the page says, and its tables name what there is."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from render import MapFile, load_maps
from tests.helpers.paths import ROOT

PAGE = (ROOT / "docs" / "maps.md").read_text()


def program(name: str) -> str:
    found = re.search(rf"<!-- {name} -->\n```python\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the writer makes, with nothing but NumPy: as another program would."""
    folder = tmp_path_factory.mktemp("maps")
    imported = re.findall(r"^(?:import|from) (\w+)", program("writer"), re.MULTILINE)
    assert imported == ["numpy"]
    subprocess.run([sys.executable, "-c", program("writer")], cwd=folder, check=True)
    return folder


def wave(vertices: np.ndarray) -> np.ndarray:
    """(2, N, 3): where the page's sheet is in its two frames."""
    x, y, _ = vertices.T
    return np.stack([np.stack([x, y, 0.01 * np.sin(12 * x + phase)], 1) for phase in (0.0, 0.8)])


def test_the_written_maps_are_those_of_the_waving_sheet(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(written)
    space: dict[str, Any] = {}
    exec(program("reader"), space)
    maps, imager = space["maps"], space["imager"]
    assert (imager.mask.numpy() == maps.mask).mean() > 0.999
    truth = wave(maps.template_vertices)
    drawn = imager.position_maps(torch.from_numpy(truth), maps.box).numpy()
    both = imager.mask.numpy() & maps.mask
    # The page's positions are of the smooth wave, the mesh's of its chords: (half / 20)² · 0.01 · 12² / 8 m apart.
    assert np.abs(drawn - maps.position)[:, both].max() * 0.6 < 2.9e-5
    distance = np.linalg.norm(space["world"] - truth, axis=-1)
    assert distance.mean() < 4e-4  # the wave stretches the sheet, which the fusion resists
    assert distance.max() < 2e-3
    exec(program("dilation"), space)
    assert space["mended"].shape == maps.position.shape
    exec(program("parts"), space)
    np.testing.assert_array_equal(load_maps("copy.npz").normal, maps.normal)


def test_the_tables_name_every_array_and_attribute() -> None:
    for field in fields(MapFile):
        assert f"`{field.name}`" in PAGE
    source = (ROOT / "render" / "maps" / "exr.py").read_text()
    for name in re.findall(r'"(\w+)": "\w+"', source):
        assert f"`{name}`" in PAGE
