"""What the garment's tokens look at (table 4): the body, its sum with them, or the other network as well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.network import NetworkConfig, TransferModel, TransferNet
from imgtransfer.network.maps import BodyMaps
from imgtransfer.network.memory import least_weights
from imgtransfer.training.checkpoint import load_model, save_model
from tests.helpers.models import model_for

PLAIN = {"encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2}, "blocks": 2, "heads": 2}


def net(attention: str) -> TransferNet:
    torch.manual_seed(0)
    return TransferNet(NetworkConfig.model_validate(PLAIN | {"attention": attention}), (16, 24)).eval()


def images(seed: int) -> torch.Tensor:
    return torch.rand(2, 1, 16, 24, 3, generator=torch.Generator().manual_seed(seed))


def test_added_tokens_by_hand() -> None:
    made, garment, body = net("added"), images(1), images(2)
    tokens = (made.encode(garment) + made.encode(body)).flatten(0, 1)
    for block in made.refinement:
        normed = block.norm_attention(tokens)
        tokens = tokens + block.attention(normed, normed)  # equation 10
        tokens = tokens + block.mlp(block.norm_mlp(tokens))  # equation 11
    torch.testing.assert_close(made(garment, body), made.decode(tokens, (2, 1)))
    assert not any("cross" in name for name in made.state_dict())


def test_cross_attention_to_the_other_network_by_hand(tube_clip: Clip) -> None:
    model = model_for(tube_clip, PLAIN | {"attention": "cross_modal", "blocks": 1})
    first, second = model.position_net, model.normal_net
    assert isinstance(first, TransferNet)
    assert isinstance(second, TransferNet)
    maps, garment = shown(model, tube_clip), model.garment()
    mine, other = (
        made.encode(image).expand(2, -1, -1, -1).flatten(0, 1)
        for made, image in ((first, garment.positions), (second, garment.normals))
    )
    (block,), body = first.refinement, first.encode(maps.images.positions).flatten(0, 1)
    mine = mine + block.cross(block.norm_cross(mine), body)
    mine = mine + block.modal(block.norm_modal(mine), block.norm_other(other))
    normed = block.norm_self(mine)
    mine = mine + block.self_attention(normed, normed)
    mine = mine + block.mlp(block.norm_mlp(mine))
    torch.testing.assert_close(model(maps).positions, first.decode(mine, (2, 2)))


def shown(model: TransferModel, clip: Clip) -> BodyMaps:
    maps: BodyMaps = model.body_imager(clip)(torch.from_numpy(clip.body.vertices[:2]))
    return maps


@pytest.mark.parametrize(("attention", "mixed"), [("body", False), ("added", False), ("cross_modal", True)])
def test_only_cross_modal_networks_see_each_other(attention: str, mixed: bool, tube_clip: Clip) -> None:
    model = model_for(tube_clip, PLAIN | {"attention": attention})
    maps = shown(model, tube_clip)
    other = replace(maps, images=replace(maps.images, normals=maps.images.normals.flip(-1)))
    before, after = model(maps), model(other)
    assert not torch.equal(before.normals, after.normals)
    assert torch.equal(before.positions, after.positions) != mixed
    tokens = model.encode_garment(model.garment())
    torch.testing.assert_close(model(maps, tokens=tokens).positions, before.positions)


@pytest.mark.parametrize("attention", ["added", "cross_modal"])
def test_its_model_is_read_back(attention: str, tube_clip: Clip, tmp_path: Path) -> None:
    model = model_for(tube_clip, PLAIN | {"attention": attention})
    count = sum(value.numel() for value in model.position_net.state_dict().values())
    assert count >= least_weights(model.network, model.maps) > count / 2
    again = load_model(save_model(tmp_path / "model.safetensors", model))
    maps = shown(model, tube_clip)
    with torch.no_grad():
        assert torch.equal(again(maps).positions, model(maps).positions)


def test_the_body_around_patches_is_attended_to() -> None:
    with pytest.raises(ValueError, match="attention: added needs body: images"):
        NetworkConfig.model_validate(
            PLAIN | {"attention": "added", "body": "local", "target": "residual", "frame": "body"}
        )
