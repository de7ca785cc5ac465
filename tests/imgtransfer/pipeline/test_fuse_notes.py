"""What is said of a body that is nowhere near the garment of the maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.pipeline.fuse_notes import note_apart
from render import Mesh, MeshSequence, load_maps
from tests.helpers.fusion_examples import write_example


@pytest.fixture
def parts(tmp_path: Path) -> tuple[object, Mesh, np.ndarray]:
    clip = write_example(tmp_path, 2)
    return load_maps(tmp_path / "maps.npz"), Mesh(clip.body.rest, clip.body.faces), clip.body.vertices


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda body: body, False),
        (lambda body: body + np.float32([0, 0, 0.2]), False),
        (lambda body: body * 100, True),
        (lambda body: body * 0.01 + np.float32([0, 3, 0]), True),
        (lambda body: body[..., [0, 2, 1]] * np.float32([1, 1, -1]) + np.float32([0, 0, 2]), True),
    ],
    ids=["worn", "beside", "centimetres", "elsewhere", "other axes"],
)
def test_a_body_elsewhere_is_noted_with_the_options(
    parts: tuple, caplog: pytest.LogCaptureFixture, change, said: bool
) -> None:
    maps, mesh, vertices = parts
    note_apart(maps, MeshSequence.of_array(mesh, change(vertices), source="body.obj"))
    assert ("is not in the garment of the maps" in caplog.text) == said
    assert ("see unit, up and facing" in caplog.text) == said
