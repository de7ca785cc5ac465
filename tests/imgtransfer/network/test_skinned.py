"""The variants that rely on linear blend skinning (table 3)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.config.loader import parse_config
from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.skinning import joint_transforms, skin
from imgtransfer.evaluation.skinning import lbs_baseline
from imgtransfer.network import NetworkConfig
from imgtransfer.network.maps import metric_maps
from imgtransfer.network.skinned import skinned_garment
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.models import model_for
from tests.helpers.training import small_config

PLAIN = {"encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2}, "blocks": 1, "heads": 2}
CANONICAL = PLAIN | {"target": "residual", "frame": "body", "guess": "skinning"}
REFINED = PLAIN | {"garment": "skinned"}


def skinned(clip: Clip) -> torch.Tensor:
    return torch.from_numpy(skinned_garment(clip, root_frames(clip, "root")))


def test_vertices_are_those_of_the_baseline(tube_clip: Clip) -> None:
    frames = root_frames(tube_clip, "root")
    wanted = frames.to_canonical(lbs_baseline(tube_clip))
    np.testing.assert_allclose(skinned(tube_clip)[..., :3], wanted, atol=2e-6)


def test_what_is_attached_to_a_vertex_turns_as_the_skinning_does(tube_clip: Clip) -> None:
    """Skinning with the same weights is affine: moving every vertex by an offset moves its image by linear @ offset."""
    frames, linear = root_frames(tube_clip, "root"), skinned(tube_clip)[..., 3:].unflatten(-1, (3, 3))
    offset = np.array([0.3, -0.2, 0.1])
    distance = np.linalg.norm(
        tube_clip.template.vertices[:, None] - tube_clip.body.rest[None], axis=-1
    ).argmin(1)
    assert tube_clip.skeleton.blend_weights is not None
    weights = tube_clip.skeleton.blend_weights[distance]
    moved = frames.to_canonical(
        skin(tube_clip.template.vertices + offset, weights, joint_transforms(tube_clip))
    )
    plain = frames.to_canonical(skin(tube_clip.template.vertices, weights, joint_transforms(tube_clip)))
    np.testing.assert_allclose((linear.numpy() @ offset), moved - plain, atol=2e-6)


def test_the_canonical_image_is_skinned(tube_clip: Clip) -> None:
    """Template and residual, both through the skinning: A (template + residual)."""
    model = model_for(tube_clip, CANONICAL)
    bodies = torch.from_numpy(root_frames(tube_clip, "root").to_canonical(tube_clip.body.vertices))
    moved = skinned(tube_clip)
    maps = model.body_imager(tube_clip)(bodies, skinned=moved)
    assert maps.guess is not None
    wanted, normals = metric_maps(model.imager, moved[..., :3].contiguous())
    assert torch.equal(maps.guess.positions, wanted)
    assert torch.equal(maps.guess.normals, normals)
    residual = torch.tensor([0.01, 0.02, -0.03])
    field = residual.expand(*wanted.shape[:-1], 3) * model.mask[..., None]
    linear = model.imager.operator(moved[..., 3:].contiguous()).unflatten(-1, (3, 3))
    torch.testing.assert_close(maps.guess.turn(field), linear @ residual)
    assert maps.garment is None


def test_the_skinned_garment_is_shown_in_place_of_the_template(tube_clip: Clip) -> None:
    model = model_for(tube_clip, REFINED)
    bodies = torch.from_numpy(root_frames(tube_clip, "root").to_canonical(tube_clip.body.vertices))
    maps = model.body_imager(tube_clip)(bodies, skinned=skinned(tube_clip))
    assert maps.garment is not None
    assert maps.guess is None
    with torch.no_grad():
        wanted = model(replace(maps, garment=None), garment=maps.garment)
        ours = model(maps, tokens=model.encode_garment(model.garment()))
        assert torch.equal(ours.positions, wanted.positions)
        assert not torch.allclose(ours.positions, model(replace(maps, garment=None)).positions)


def test_a_residual_of_networks_that_see_the_skinned_garment_has_its_first_guess(tube_clip: Clip) -> None:
    bodies = torch.from_numpy(root_frames(tube_clip, "root").to_canonical(tube_clip.body.vertices))
    plain = model_for(tube_clip, PLAIN | {"target": "residual"})
    shown = model_for(tube_clip, REFINED | {"target": "residual"})
    maps = shown.body_imager(tube_clip)(bodies, skinned=skinned(tube_clip))
    wanted = plain.body_imager(tube_clip)(bodies).guess
    assert maps.garment is not None
    assert maps.guess is not None
    assert wanted is not None
    assert torch.equal(maps.guess.positions, wanted.positions)


@pytest.mark.parametrize("network", [CANONICAL, REFINED], ids=["canonical", "refined"])
def test_it_is_trained_and_predicted_mirrored(
    network: dict[str, object], tube_clip: Clip, tmp_path: Path
) -> None:
    (tmp_path / "clips").mkdir()
    for name in ("first", "second_test"):
        save_clip(tmp_path / "clips" / f"{name}.npz", tube_clip)
    values = small_config(tmp_path / "clips", steps=2, mirror=True).model_dump(mode="json") | {
        "network": network
    }
    config = parse_config(RunConfig, values, "small")
    trainer = Trainer(config)
    before = trainer.validate()
    assert np.isfinite(list(before.values())).all()
    if network is CANONICAL:  # networks begin with a residual of 0; normals are made unit
        assert before["position_mm"] == pytest.approx(before["guess_position_mm"], rel=1e-3)
    train(config, tmp_path / "run")
    prediction = load_model(tmp_path / "run").predict(tube_clip)
    assert prediction.positions.isfinite().all()
    unskinned = replace(tube_clip, skeleton=replace(tube_clip.skeleton, blend_weights=None))
    with pytest.raises(InputError, match="no skinning; it lacks blend_weights"):
        load_model(tmp_path / "run").predict(unskinned)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"guess": "skinning"}, "guess: skinning needs target: residual"),
        (
            {"garment": "skinned", "body": "local", "target": "residual", "frame": "body"},
            "guess: skinning and garment: skinned need body: images",
        ),
    ],
)
def test_what_does_not_go_together(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        NetworkConfig.model_validate(PLAIN | changes)
