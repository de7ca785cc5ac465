"""The frozen part of encoders, computed once a frame: nothing else changes."""

from __future__ import annotations

import errno
import logging
import os
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from imgtransfer.network.shared_trunk import share_trunks
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.trainer import Trainer
from tests.helpers.hub import checkpoint
from tests.helpers.training import hub_config


def trained(trainer: Trainer, steps: int = 4) -> tuple[list[dict[str, float]], dict[str, torch.Tensor]]:
    losses = [trainer.train_step() for _ in range(steps)]
    return losses, trainer.model.state_dict()


@pytest.mark.parametrize(("kind", "mirror"), [("dinov3_vit", True), ("resnet", False)])
def test_the_same_training_as_without(kind: str, mirror: bool, source: Path, tmp_path: Path) -> None:
    folder = checkpoint(tmp_path / "encoder", kind)
    config = hub_config(source, folder, mirror=mirror)
    plain, cached, again = (Trainer(config) for _ in range(3))
    for trainer in (cached, again):
        trainer.cache_trunks(tmp_path)
    again.rehearse()  # frames in another order
    losses, weights = trained(plain)
    with_cache, kept = trained(cached)
    for without, there in zip(losses, with_cache, strict=True):
        assert there == pytest.approx(without, rel=1e-4)
    # Sums over another number of rows round otherwise; Adam's first steps make much of it.
    for name, value in kept.items():
        torch.testing.assert_close(value, weights[name], rtol=0, atol=2e-3, msg=name)
    assert all(torch.equal(kept[name], value) for name, value in trained(again)[1].items())
    assert cached._image_losses._trunks is not None
    assert 0 < cached._image_losses._trunks.filled <= (1 + mirror) * len(cached.train_frames)


def test_a_frame_is_computed_once(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer = Trainer(hub_config(source, checkpoint(tmp_path / "encoder"), mirror=False))
    trainer.cache_trunks(tmp_path)
    encoder = trainer.model.position_net.encoder
    seen: list[int] = []
    original = type(encoder).trunk
    monkeypatch.setattr(
        type(encoder), "trunk", lambda self, images: seen.append(len(images)) or original(self, images)
    )
    for _ in range(12):
        trainer.train_step()
    frames = len(trainer.train_frames)
    assert seen == [2] * 2 * frames  # two views a frame, in each of two networks


def frozen_places(trainer: Trainer) -> list[list[int]]:
    """Where in memory each frozen weight of an encoder lies: of both networks, and as it is averaged."""
    nets = {
        name: dict(getattr(trainer.model, name).named_parameters()) for name in ("position_net", "normal_net")
    }
    assert trainer._average is not None
    mean = trainer._average.tensors()
    frozen = [name for name, weight in nets["normal_net"].items() if not weight.requires_grad]
    assert any("layers.0" in name or "layer.0" in name for name in frozen)
    return [
        [weights[name].data_ptr() for weights in nets.values()]
        + [mean[f"{net}.{name}"].data_ptr() for net in nets]
        for name in frozen
    ]


def test_frozen_weights_are_in_memory_once(source: Path, tmp_path: Path) -> None:
    config = hub_config(source, checkpoint(tmp_path / "encoder"), ema=0.5)
    trainer, again = Trainer(config), Trainer(config)
    for _ in range(2):
        trainer.train_step()
        trainer.validate()  # with the averaged weights
        assert all(len(set(places)) == 1 for places in frozen_places(trainer))
    trainer.save(tmp_path)
    again.load(tmp_path)
    assert all(len(set(places)) == 1 for places in frozen_places(again))
    losses = trainer.train_step(), again.train_step()
    assert losses[0] == losses[1]
    model, stored = load_model(tmp_path), load_file(tmp_path / "model.safetensors")
    first, second = (dict(network.named_parameters()) for network in (model.position_net, model.normal_net))
    for name, weight in first.items():
        assert (weight.data_ptr() == second[name].data_ptr()) == (not weight.requires_grad)
        assert torch.equal(weight, stored[f"model.position_net.{name}"].float())


def test_frozen_weights_that_differ_stay_apart() -> None:
    first, second = (nn.Linear(2, 2).requires_grad_(False) for _ in range(2))
    second.bias.copy_(first.bias)
    before = second.weight.clone()
    share_trunks(first, second)
    assert second.bias.data_ptr() == first.bias.data_ptr()
    assert second.weight.data_ptr() != first.weight.data_ptr()
    assert torch.equal(second.weight, before)


def test_it_says_what_it_takes_and_leaves_no_file(
    source: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    folder, out = checkpoint(tmp_path / "encoder"), tmp_path / "run"
    out.mkdir()
    trainer = Trainer(hub_config(source, folder))
    trainer.cache_trunks(out)
    assert not list(out.iterdir())
    # 6 frames, mirrored too, 2 networks, 2 views, 17 tokens of 32 features: 104 kB.
    rows = 2 * len(trainer.train_frames)
    assert f"makes of {rows} bodies takes 0.00 GB in {out} until the run ends" in caplog.text
    assert trainer._image_losses._trunks is not None
    assert trainer._image_losses._trunks.kept is not None
    assert trainer._image_losses._trunks.kept[0].shape == (rows, 2, 5, 32)


def test_where_it_takes_too_much_bodies_are_computed_anew(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    folder = checkpoint(tmp_path / "encoder")
    small = Trainer(hub_config(source, folder, trunk_cache_gb=1e-6))
    small.cache_trunks(tmp_path)
    assert "more than training.trunk_cache_gb (1e-06), and is computed anew" in caplog.text

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    on_a_full_disk = Trainer(hub_config(source, folder))
    on_a_full_disk.cache_trunks(tmp_path)
    assert "there is no room ([Errno 28] No space left on device), and it is computed anew" in caplog.text
    for trainer in (small, on_a_full_disk):
        assert trainer._image_losses._trunks is not None
        assert trainer._image_losses._trunks.kept is None
        trainer.train_step()
    assert [path.name for path in tmp_path.iterdir()] == ["encoder"]
