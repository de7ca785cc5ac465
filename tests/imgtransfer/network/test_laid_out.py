"""Images of garment and body laid out flat in place of views (`maps.views: uv`, table 7)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imgtransfer.config.loader import parse_config
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.network import MapsConfig
from imgtransfer.pipeline.deform import deform
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from render import InputError
from tests.helpers.training import small_config


def uv_config(clips: Path, network: dict[str, Any], **training: object) -> RunConfig:
    values = small_config(clips, steps=4, mirror=False, **training).model_dump(mode="json")
    values["maps"]["views"] = "uv"
    values["network"] |= network
    return parse_config(RunConfig, values, "small")


@pytest.fixture
def clips(tube_clip: Clip, tmp_path: Path) -> Path:
    (tmp_path / "clips").mkdir()
    for name in ("first", "second_test"):
        save_clip(tmp_path / "clips" / f"{name}.npz", tube_clip)
    return tmp_path / "clips"


@pytest.mark.parametrize(
    "network",
    [{"guess": "skinning"}, {"target": "absolute", "frame": "canonical"}],
    ids=["residual", "absolute"],
)
def test_it_is_trained_predicts_and_is_fused(
    network: dict[str, Any], tube_clip: Clip, clips: Path, tmp_path: Path
) -> None:
    train(uv_config(clips, network), tmp_path / "run")
    model = load_model(tmp_path / "run")
    assert model.maps.views == ("uv",)
    assert model.mask.shape == (1, 32, 32)
    assert model.layouts is not None
    assert model.imager.layout is not None
    prediction = model.predict(tube_clip)
    assert prediction.positions.isfinite().all()
    parts = [model.predictor(tube_clip)(tube_clip.slice(slice(i, i + 1))) for i in range(tube_clip.n_frames)]
    alone = torch.cat([part.positions for part in parts])
    torch.testing.assert_close(prediction.positions, alone, atol=1e-6, rtol=0)
    fused = deform(model, tube_clip).fused
    assert fused.shape == (tube_clip.n_frames, len(tube_clip.template.vertices), 3)
    assert np.isfinite(fused).all()
    # The layouts come from the file, so that another version of xatlas changes nothing.
    again = load_model(tmp_path / "run")
    assert again.layouts is not None
    for one, other in zip(model.layouts, again.layouts, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


@pytest.mark.parametrize("written", ["uv", ["uv"]])
def test_how_it_is_written(written: object) -> None:
    config = MapsConfig.model_validate({"views": written})
    assert config.laid_out
    assert MapsConfig.model_validate(config.model_dump(mode="json")) == config


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"maps": {"views": ["uv", "front"]}}, "uv stands alone"),
        ({"maps": {"views": "uv", "layers": 2}}, "uv has one layer, found 2"),
        ({"training": {"mirror": True}}, "maps.views: uv needs training.mirror: false"),
        (
            {"network": {"guess": "body"}},
            "maps.views: uv needs network.guess: skinning, or network.target: absolute",
        ),
        (
            {"network": {"body": "local", "guess": "body", "shortcuts": False}},
            "maps.views: uv needs network.body: images",
        ),
    ],
)
def test_what_it_does_not_go_with(changes: dict[str, dict[str, Any]], said: str, tmp_path: Path) -> None:
    values = uv_config(tmp_path, {"guess": "skinning"}).model_dump(mode="json")
    for section, settings in changes.items():
        values[section] |= settings
    with pytest.raises(InputError, match=said):
        parse_config(RunConfig, values, "small")


def test_a_body_of_other_faces_is_refused(tube_clip: Clip, clips: Path, tmp_path: Path) -> None:
    train(uv_config(clips, {"guess": "skinning"}), tmp_path / "run")
    turned = replace(tube_clip, body=replace(tube_clip.body, faces=tube_clip.body.faces[::-1]))
    with pytest.raises(InputError, match=r"its layout has .* that are not those of the mesh"):
        load_model(tmp_path / "run").predict(turned)
