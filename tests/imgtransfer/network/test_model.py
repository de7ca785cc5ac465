"""Models of other views than front and back, and of more than one layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from imgtransfer.data.clip import Clip
from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.network.mirror import Mirror
from imgtransfer.training.checkpoint import load_model, save_model
from render import InputError, Mesh, PositionBox, TemplateImager

NETWORK = {"encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2}, "blocks": 1, "shortcuts": True}


def model_with(clip: Clip, **maps: object) -> TransferModel:
    torch.manual_seed(0)
    return TransferModel(
        maps=MapsConfig.model_validate({"size": (32, 40), **maps}),
        network=NetworkConfig.model_validate(NETWORK),
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=PositionBox.around(clip.template.vertices, margin=0.5),
    ).eval()


@pytest.mark.parametrize(
    ("written", "views"),
    [
        ("four", ("0/auto", "180/auto", "90/auto", "-90/auto")),
        (["front", [45, 20]], ("front", "45/20")),
        ("ring:3", ("front", "120/0", "-120/0")),
        (["back", "30/-10"], ("back", "30/-10")),
    ],
)
def test_views_of_a_configuration(written: object, views: tuple[str, ...]) -> None:
    config = MapsConfig.model_validate({"views": written})
    assert config.views == views
    assert MapsConfig.model_validate(config.model_dump(mode="json")) == config


@pytest.mark.parametrize("views", ["top", [], ["front", "0/0"], 4, None, [["a", "b"]]])
def test_views_that_are_none_are_refused(views: object) -> None:
    with pytest.raises(ValidationError, match="views"):
        MapsConfig.model_validate({"views": views})


def test_a_model_of_four_views_and_two_layers_predicts_and_comes_back(
    tube_clip: Clip, tmp_path: Path
) -> None:
    model = model_with(tube_clip, views="four", layers=2)
    names = [camera.name for camera in model.imager.cameras]
    assert len(names) == 8
    assert model.maps.layers == 2
    # The heights chosen for the template are part of the model: whoever loads it does not choose again.
    assert list(model.maps.views) == names[::2]
    assert not any("auto" in name for name in names)
    prediction = model.predict(tube_clip)
    assert prediction.positions.shape == (6, 8, 32, 40, 3)
    again = load_model(save_model(tmp_path / "model.safetensors", model))
    assert again.maps == model.maps
    for camera, same in zip(model.imager.cameras, again.imager.cameras, strict=True):
        np.testing.assert_array_equal(camera.view, same.view)
        assert (camera.name, camera.layer, camera.size) == (same.name, same.layer, same.size)
    assert torch.equal(again.predict(tube_clip).positions, prediction.positions)


def test_the_bodys_layers_are_the_bodys_own_surfaces(tube_clip: Clip) -> None:
    model = model_with(tube_clip, layers=2)
    body = model.body_imager(tube_clip).imager
    assert [camera.layer for camera in body.cameras] == [0, 1, 0, 1]
    # From in front the second surface of a closed body is its back.
    depth = torch.from_numpy(body.raster.depth)
    both = body.mask[0] & body.mask[1]
    assert both.sum() > 50
    assert bool((depth[1][both] > depth[0][both]).all())


@pytest.mark.parametrize("views", ["front", "front,back", "0/20,180/-10"])
def test_views_from_front_and_back_at_any_height_can_be_mirrored(tube_clip: Clip, views: str) -> None:
    mesh = Mesh(tube_clip.template.vertices, tube_clip.template.faces)
    imager = TemplateImager.build(mesh, views=views, layers=2, size=(32, 40))
    box = PositionBox.around(mesh.vertices)
    assert Mirror(imager, imager.mask, imager.mask, box).mask.shape == imager.mask.shape


def test_views_from_the_sides_cannot_be_mirrored(tube_clip: Clip) -> None:
    imager = TemplateImager.build(Mesh(tube_clip.template.vertices, tube_clip.template.faces), views="four")
    sides = [camera.name for camera in imager.cameras][2:]
    with pytest.raises(InputError, match="found " + ", ".join(sides)):
        Mirror(imager, imager.mask, imager.mask, PositionBox.around(tube_clip.template.vertices))
