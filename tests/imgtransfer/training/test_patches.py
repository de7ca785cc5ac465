"""What local networks are trained on, patch by patch, against whole images."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch

from imgtransfer.config.loader import parse_config
from imgtransfer.network.local_transfer import images_to_patches, patches_to_images
from imgtransfer.network.residuals import NORMAL_RESIDUAL, POSITION_RESIDUAL_M
from imgtransfer.training import prepared
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.patches import PatchFrames, PatchTemplate, patch_masks
from imgtransfer.training.prepared import MARK_FILE, PREPARED_FILE
from imgtransfer.training.trainer import Trainer
from render import InputError, decode_normals
from tests.helpers.models import LOCAL
from tests.helpers.training import small_config


def local_config(source: Path, **training: object) -> RunConfig:
    content = small_config(source, **training).model_dump(mode="json", exclude_unset=True)
    return parse_config(RunConfig, content | {"network": LOCAL}, "local")


@pytest.fixture(scope="module")
def trainer(source: Path) -> Trainer:
    """With networks that say something; read only."""
    trainer = Trainer(local_config(source, mirror=True))
    torch.manual_seed(1)
    for network in (trainer.model.position_net, trainer.model.normal_net):
        torch.nn.init.normal_(network.to_patch.weight, std=0.1)
    return trainer


def test_patches_lie_in_the_image_where_they_were_cut() -> None:
    images = torch.arange(2 * 1 * 4 * 6 * 1.0).view(2, 1, 4, 6, 1)
    shown = torch.tensor([[[True, False, True], [False, True, False]]])
    patches = images_to_patches(images, shown)
    assert patches.shape == (2, 3, 2, 2, 1)
    assert patches[0, 1, ..., 0].tolist() == [[4, 5], [10, 11]]  # top right
    assert patches[1, 2, ..., 0].tolist() == [[24 + 14, 24 + 15], [24 + 20, 24 + 21]]  # bottom middle
    back = patches_to_images(patches, shown)
    kept = torch.tensor([[1, 1, 0, 0, 1, 1]] * 2 + [[0, 0, 1, 1, 0, 0]] * 2).bool()
    assert torch.equal(back[:, 0, ..., 0], images[:, 0, ..., 0] * kept)


def test_the_residual_of_a_patch_leads_from_the_guess_to_the_truth(trainer: Trainer) -> None:
    index = torch.tensor([0, 2])
    outfit = trainer._outfit(trainer.train_frames, index)
    body, truth = trainer.batch(trainer.train_frames, index)
    made = PatchFrames.of(outfit, body, truth)
    whole = patches_to_images(made.residuals, outfit.garment.covered[0])
    mask = outfit.model.mask
    positions = body.guess.positions + body.guess.turn(POSITION_RESIDUAL_M * whole[..., :3])
    torch.testing.assert_close(
        positions[:, mask], outfit.model.box.decode(truth.positions)[:, mask], rtol=0, atol=1e-5
    )
    normals = body.guess.normals + body.guess.turn(NORMAL_RESIDUAL * whole[..., 3:])
    torch.testing.assert_close(normals[:, mask], decode_normals(truth.normals)[:, mask], rtol=0, atol=1e-4)


def test_mirrored_patches_are_those_of_the_mirrored_maps(trainer: Trainer) -> None:
    index = torch.tensor([1, 3])
    outfit = trainer._outfit(trainer.train_frames, index)
    body, truth = trainer.batch(trainer.train_frames, index)
    template, made = PatchTemplate.of(outfit), PatchFrames.of(outfit, body, truth)
    mirrored = made.mirrored(template, torch.tensor([True, False]))
    torch.testing.assert_close(mirrored.local[1], made.local[1])
    # The loop: each patch of the mirrored template, looked up in mirrored images.
    images = outfit.mirror.body(body)
    shown = template.views[1].covered[0]
    torch.testing.assert_close(mirrored.local[0], images.local[0][shown])
    whole = patches_to_images(made.residuals, template.views[0].covered[0])[0].flip(2)
    whole = whole * torch.tensor([-1.0, 1, 1, -1, 1, 1])
    torch.testing.assert_close(mirrored.residuals[0], images_to_patches(whole[None], shown)[0])
    masks = patch_masks(template, torch.tensor([True, False]))
    assert torch.equal(masks[0], images_to_patches(outfit.mirror.mask[None, ..., None], shown)[0, ..., 0])
    assert torch.equal(masks[1], template.mask)


def test_the_loss_is_that_of_what_the_model_predicts(trainer: Trainer, tmp_path: Path) -> None:
    trainer.prepare(tmp_path)
    index = torch.tensor([0, 1, 4])
    losses = trainer._losses(0, index, torch.zeros(3, dtype=torch.bool))
    outfit = trainer._outfit(trainer.train_frames, index)
    body, truth = trainer.batch(trainer.train_frames, index)
    shown, mask = outfit.garment.covered[0], outfit.model.mask
    residuals = patches_to_images(PatchFrames.of(outfit, body, truth).residuals, shown)
    for number, network in enumerate((trainer.model.position_net, trainer.model.normal_net)):
        said = network(outfit.garment, body.local)
        wanted = residuals[..., 3 * number : 3 * number + 3]
        plain = sum((said[frame][mask] - wanted[frame][mask]).abs().mean() for frame in range(3)) / 3
        assert losses[number].item() == pytest.approx(plain.item(), rel=2e-3)  # prepared in float16


def test_what_is_prepared_is_removed_at_the_end_and_kept_for_a_run_that_goes_on(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainer = Trainer(local_config(source, steps=2))
    trainer.prepare(tmp_path)
    first = (tmp_path / PREPARED_FILE).stat().st_mtime_ns
    again = Trainer(local_config(source, steps=2))
    again.prepare(tmp_path)
    assert (tmp_path / PREPARED_FILE).stat().st_mtime_ns == first
    (tmp_path / MARK_FILE).write_text(json.dumps({"mark": "another", "bytes": 1}))
    again.prepare(tmp_path)
    assert (tmp_path / PREPARED_FILE).stat().st_mtime_ns != first
    train(local_config(source, steps=1), tmp_path / "run")
    assert not list((tmp_path / "run").glob("prepared*"))


def test_a_full_disk_is_noticed_before_anything_is_made(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        prepared.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 10**6)
    )
    with pytest.raises(
        InputError, match=r"prepared.f16: prepared frames take up to 0.0 GB, and 0.0 GB are free"
    ):
        Trainer(local_config(source, steps=2)).prepare(tmp_path)
    assert not list(tmp_path.iterdir())
