"""Checkpoints of pretrained encoders: whole or refused, by name or folder, never a pickle."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from huggingface_hub import constants
from safetensors.torch import load_file, save_file
from torch import Tensor

from imgtransfer.network.encoder_config import HubEncoderConfig
from imgtransfer.network.hub_checkpoint import checkpoint_folder, kept_values, pretrained_model, read_config
from imgtransfer.network.hub_encoder import build_hub_encoder
from render import InputError
from tests.helpers.hub import checkpoint

WEIGHTS = "model.safetensors"


def read(folder: Path) -> None:
    pretrained_model(checkpoint_folder(str(folder)), read_config(folder))


def change(folder: Path, edit: Callable[[dict[str, Tensor]], object]) -> None:
    tensors = load_file(folder / WEIGHTS)
    edit(tensors)
    save_file(tensors, folder / WEIGHTS, metadata={"format": "pt"})


def test_a_pooler_and_a_classifier_are_left_out(tmp_path: Path) -> None:
    checkpoint(tmp_path)
    assert any(key.startswith("pooler.") for key in load_file(tmp_path / WEIGHTS))
    change(tmp_path, lambda tensors: tensors.update({"classifier.weight": torch.zeros(2, 32)}))
    read(tmp_path)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda tensors: tensors.pop("layernorm.weight"), "lacks layernorm.weight"),
        (lambda tensors: tensors.update(odd=torch.zeros(3)), "has, beside what the encoder has, odd"),
        (
            lambda tensors: tensors.update({"layernorm.bias": torch.zeros(5)}),
            "has in another shape layernorm.bias",
        ),
        (lambda tensors: tensors["layernorm.bias"].fill_(torch.nan), "has weights that are not finite"),
    ],
)
def test_weights_are_all_there_and_no_others(
    edit: Callable[[dict[str, Tensor]], object], said: str, tmp_path: Path
) -> None:
    checkpoint(tmp_path)
    change(tmp_path, edit)
    with pytest.raises(InputError) as refused:
        read(tmp_path)
    assert said in str(refused.value)
    assert "fetch the checkpoint anew" in str(refused.value)


def test_damaged_weights(tmp_path: Path) -> None:
    checkpoint(tmp_path)
    (tmp_path / WEIGHTS).write_bytes(b"no tensors")
    with pytest.raises(InputError, match="its weights cannot be read"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"model_type": "bert"}, "found 'bert'"),
        ({}, "found None"),
        ({"hidden_size": 10**9}, "hidden_size must be from 1 to 8192, found 1000000000"),
        ({"num_hidden_layers": "many"}, "num_hidden_layers must be from 1 to 256, found 'many'"),
        ({"num_register_tokens": -1}, "num_register_tokens must be from 0 to 256, found -1"),
        ({"hidden_act": 7}, "not the configuration of an encoder"),
    ],
)
def test_a_configuration_of_something_else(values: dict[str, object], said: str, tmp_path: Path) -> None:
    checkpoint(tmp_path)
    path = tmp_path / "config.json"
    known = json.loads(path.read_text()) if values else {}
    path.write_text(json.dumps(known | values))
    with pytest.raises(InputError) as refused:
        read(tmp_path)
    assert said in str(refused.value)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    checkpoint(tmp_path)
    tensors = load_file(tmp_path / WEIGHTS)
    torch.save(tensors, tmp_path / "pytorch_model.bin")
    (tmp_path / WEIGHTS).unlink()
    with pytest.raises(InputError, match=r"no model\.safetensors; weights in any other form are not read"):
        read(tmp_path)


def test_a_folder_without_a_configuration(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"no config\.json; a folder with config\.json and model\.safetensors"
    ):
        checkpoint_folder(str(tmp_path))


def test_offline_and_never_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(InputError) as refused:
        build_hub_encoder(HubEncoderConfig(), (256, 256))
    said = str(refused.value)
    assert said.startswith(
        "network.encoder.name: facebook/dino-vitb16 is no folder and has not been fetched before"
    )
    assert "run `hf download facebook/dino-vitb16` where there is a network, or give a folder" in said


@pytest.mark.parametrize("name", ["/nowhere", "neither/a/name/nor/folder", "~/encoder", "../encoder"])
def test_a_folder_that_is_not_there_is_not_asked_of_the_hub(name: str) -> None:
    with pytest.raises(InputError) as refused:
        checkpoint_folder(name)
    assert str(refused.value).startswith(
        f"network.encoder.name: there is no folder {name}, and the hub has no"
    )


def test_what_was_fetched_is_read_offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    place = tmp_path / "models--some--encoder"
    (place / "refs").mkdir(parents=True)
    (place / "refs" / "main").write_text("1" * 40)
    checkpoint(place / "snapshots" / ("1" * 40))
    folder = checkpoint_folder("some/encoder")
    assert folder == place / "snapshots" / ("1" * 40)
    read(folder)


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoint(tmp_path)
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(
        InputError, match=r"needs the package transformers: pip install 'imgtransfer\[encoders\]'"
    ):
        read(tmp_path)


def test_the_kept_architecture_is_plain_and_has_no_labels(tmp_path: Path) -> None:
    values = kept_values(read_config(checkpoint(tmp_path)))
    assert json.loads(json.dumps(values)) == values
    assert (values["model_type"], values["hidden_size"]) == ("vit", 32)
    assert not {"id2label", "architectures"} & set(values)
