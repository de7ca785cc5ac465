"""How far off the skin cloth rests: measured of the training clips, kept in the model, and kept to by the fusion."""

from __future__ import annotations

from pathlib import Path

import pytest

from fusion import FusionConfig
from imgtransfer.data.clip import save_clip
from imgtransfer.data.contact_offset import of_clips
from imgtransfer.pipeline.deform import deform
from imgtransfer.training.checkpoint import load_model, save_model
from imgtransfer.training.trainer import Trainer
from tests.helpers.synthetic import tube_clip
from tests.helpers.training import small_config


def test_a_model_knows_how_far_off_the_skin_its_clips_cloth_rests(source: Path, tmp_path: Path) -> None:
    clip = tube_clip(girth=0.3)
    for name in ("first", "second_test"):
        save_clip(tmp_path / "clips" / f"{name}.npz", clip)
    model = Trainer(small_config(tmp_path / "clips")).model
    assert model.contact_offset_m == pytest.approx(of_clips([clip]), abs=1e-6)
    assert Trainer(small_config(source)).model.contact_offset_m is None  # 4 cm off: it rests on nothing
    save_model(tmp_path / "model.safetensors", model)
    loaded = load_model(tmp_path)
    assert loaded.contact_offset_m == model.contact_offset_m
    assert loaded.predict(clip).contact_offset_m == model.contact_offset_m
    fewest = FusionConfig(edge_iterations=1, normal_iterations=1)
    report = deform(loaded, clip, fewest).report
    assert report["collision_margin_m"] == model.contact_offset_m
    loaded.contact_offset_m = None
    assert deform(loaded, clip, fewest).report["collision_margin_m"] == 0
