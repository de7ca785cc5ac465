"""Pretrained encoders: the tokens of `transformers`, frozen but for the end, from checkpoints that are whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from imgtransfer.network.encoder_config import HubEncoderConfig
from imgtransfer.network.hub_encoder import HubEncoder, build_hub_encoder
from render import InputError
from tests.helpers.hub import REGISTERS, VITS, checkpoint, random_model

MEAN = torch.tensor([0.485, 0.456, 0.406])[:, None, None]
STD = torch.tensor([0.229, 0.224, 0.225])[:, None, None]


def encoder(folder: Path, size: tuple[int, int] = (64, 64), **settings: Any) -> HubEncoder:
    config = HubEncoderConfig(name=str(folder), **settings)
    return build_hub_encoder(config, size).train()


def images(height: int = 64, width: int = 64) -> Tensor:
    return torch.rand(2, 3, height, width, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("kind", VITS)
def test_tokens_are_those_of_transformers(kind: str, tmp_path: Path) -> None:
    ours, model, shown = encoder(checkpoint(tmp_path, kind)), random_model(kind), images()
    seen = shown
    if kind.startswith("dinov2"):  # patches of 14 pixels stand for 16 of the map
        seen = torch.nn.functional.interpolate(shown, (56, 56), mode="bilinear", antialias=True)
    with torch.no_grad():
        wanted = model((seen - MEAN) / STD).last_hidden_state
        torch.testing.assert_close(ours(shown), wanted, rtol=1e-4, atol=1e-5)
    assert (ours.patch, ours.grid, ours.dim) == (16, (4, 4), 32)
    assert ours.prefix == (1 + REGISTERS if kind in ("dinov2_with_registers", "dinov3_vit") else 1)
    assert wanted.shape[1] == ours.prefix + 16


@pytest.mark.parametrize("kind", VITS)
def test_position_embeddings_are_interpolated_to_the_maps(kind: str, tmp_path: Path) -> None:
    """197 tokens to 257 in the paper; here 17 to 25."""
    ours, model = encoder(checkpoint(tmp_path, kind), (80, 80)), random_model(kind)
    shown = images(80, 80)
    seen = torch.nn.functional.interpolate(shown, ours.image, mode="bilinear", antialias=True)
    options = {"interpolate_pos_encoding": True} if kind == "vit" else {}
    with torch.no_grad():
        wanted = model((seen - MEAN) / STD, **options).last_hidden_state
        torch.testing.assert_close(ours(shown), wanted, rtol=1e-4, atol=1e-5)
    assert wanted.shape[1] == ours.prefix + 25


def test_maps_need_not_be_square(tmp_path: Path) -> None:
    ours = encoder(checkpoint(tmp_path), (32, 96))
    assert ours(images(32, 96)).shape == (2, 1 + 2 * 6, 32)


@pytest.mark.parametrize("kind", [*VITS, "resnet"])
def test_only_the_last_blocks_and_the_norm_are_trained(kind: str, tmp_path: Path) -> None:
    ours = encoder(checkpoint(tmp_path, kind))
    ours(images()).square().sum().backward()
    trained = {name for name, weight in ours.named_parameters() if weight.requires_grad}
    assert trained == {name for name, weight in ours.named_parameters() if weight.grad is not None}
    assert {name for name, weight in ours.named_parameters() if weight.grad is not None and weight.grad.any()}
    if kind == "resnet":
        assert all(".stages.3." in name and ".normalization." not in name for name in trained)
        assert any(name.startswith("hub.encoder.stages.3.layers.0.") for name in trained)
    else:
        ends = [part for name in trained for part in name.split(".") if part.isdecimal()]
        assert set(ends) == {"1", "2"}
        assert {name.split(".")[1] for name in trained if not set(name.split(".")) & {"1", "2"}} == {
            "norm" if kind == "dinov3_vit" else "layernorm"
        }
    assert not ours.trunk(images()).requires_grad
    assert not any(module.training for module in ours.hub.modules())


def test_no_block_trained_leaves_the_norm(tmp_path: Path) -> None:
    ours = encoder(checkpoint(tmp_path), trained_blocks=0)
    names = [name for name, weight in ours.named_parameters() if weight.requires_grad]
    assert names == ["hub.layernorm.weight", "hub.layernorm.bias"]


def test_tokens_of_a_resnet_are_its_last_map(tmp_path: Path) -> None:
    ours, model = encoder(checkpoint(tmp_path, "resnet"), dim=64), random_model("resnet")
    with torch.no_grad():
        wanted = model((images() - MEAN) / STD).last_hidden_state
        assert wanted.shape == (2, 32, 2, 2)
        tokens = wanted.flatten(2).mT
        tokens = ours.project(torch.cat([tokens.mean(1, keepdim=True), tokens], 1))
        torch.testing.assert_close(ours(images()), tokens, rtol=1e-4, atol=1e-4)
    assert (ours.patch, ours.grid, ours.dim, ours.prefix) == (32, (2, 2), 64, 1)
    assert not [name for name in ours.state_dict() if "num_batches" in name]


@pytest.mark.parametrize("kind", [*VITS, "resnet"])
def test_an_architecture_makes_the_encoder_without_its_checkpoint(kind: str, tmp_path: Path) -> None:
    ours = encoder(checkpoint(tmp_path, kind), (64, 96), dim=64)
    config = HubEncoderConfig(name="nowhere", dim=64)
    again = build_hub_encoder(config, (64, 96), ours.architecture)
    again.load_state_dict(ours.state_dict(), strict=True)
    with torch.no_grad():
        assert torch.equal(again(images(64, 96)), ours(images(64, 96)))
    assert again.architecture == ours.architecture


def test_bfloat16_products(tmp_path: Path) -> None:
    """Turned queries are float32, values bfloat16."""
    ours = encoder(checkpoint(tmp_path, "dinov3_vit"))
    with torch.autocast("cpu", torch.bfloat16):
        rough = ours(images())
    torch.testing.assert_close(rough.float(), ours(images()), rtol=0.1, atol=0.1)


def test_sizes_that_do_not_suit(tmp_path: Path) -> None:
    checkpoint(tmp_path)
    for size, settings, said in (
        (
            (64, 72),
            {},
            "maps.size is 64x72 (height x width), not a multiple of the 16 pixels of a token of vit",
        ),
        ((64, 64), {"trained_blocks": 4}, "network.encoder.trained_blocks is 4, and vit has 3"),
        ((64, 64), {"dim": 40}, "tokens of 40 features are not a multiple of 16"),
    ):
        with pytest.raises(InputError) as refused:
            encoder(tmp_path, size, **settings)
        assert said in str(refused.value)
    with pytest.raises(InputError, match="images are 32x64"):
        encoder(tmp_path)(images(32, 64))
