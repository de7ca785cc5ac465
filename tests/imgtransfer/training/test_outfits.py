"""One model for several garments and bodies: training on them, and predicting for others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.cli.main import main
from imgtransfer.config.loader import parse_config
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.network import TransferModel
from imgtransfer.training import outfits
from imgtransfer.training.checkpoint import load_model, read_tensors, write_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.order import PACK, Order
from imgtransfer.training.trainer import Trainer
from render import InputError, Mesh, load_maps
from tests.helpers.models import LOCAL
from tests.helpers.synthetic import tube_clip
from tests.helpers.training import SMALL, small_config

UNSEEN = {"rings": 9, "sides": 10, "girth": 1.1, "tall": 1.2}


@pytest.fixture(scope="module")
def wardrobe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clips of two garments, the second on another body, and the first in another shape as well."""
    folder = tmp_path_factory.mktemp("wardrobe")
    for name, clip in {
        "first": tube_clip(4),
        "stout": tube_clip(2, girth=1.2),
        "second": tube_clip(3, rings=10, sides=12),
        "first_test": tube_clip(2),
        "second_test": tube_clip(2, rings=10, sides=12),
    }.items():
        save_clip(folder / f"{name}.npz", clip)
    return folder


def local_config(source: Path, **training: object) -> RunConfig:
    content = small_config(source, **training).model_dump(mode="json", exclude_unset=True)
    return parse_config(RunConfig, content | {"network": LOCAL}, "local")


@pytest.fixture(scope="module")
def general(wardrobe: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of three steps on the wardrobe: read only."""
    folder = tmp_path_factory.mktemp("general") / "run"
    train(local_config(wardrobe, steps=3), folder)
    return folder


def test_clips_are_grouped_by_outfit_and_its_shapes(wardrobe: Path) -> None:
    frames = Trainer(local_config(wardrobe)).train_frames
    assert [[clip.name for clip in shapes] for shapes in frames.outfits] == [["first", "stout"], ["second"]]
    # Frames 0 to 3 are of the first clip, 4 to 6 of the second, 7 and 8 of the stout one.
    of = {number: places.tolist() for number, places in frames.by_outfit(torch.tensor([8, 4, 0, 5]))}
    assert of == {0: [0, 2], 1: [1, 3]}
    garment, body, shape = frames.read(torch.tensor([0, 8]))
    assert (garment.shape, body.shape, shape.tolist()) == ((2, 192, 3), (2, 128, 3), [0, 1])


def test_the_gradient_of_a_mixed_batch_is_the_mean_of_its_frames(wardrobe: Path, tmp_path: Path) -> None:
    trainer = Trainer(local_config(wardrobe, batch_frames=9, gradient_clip=None, mirror=True))
    trainer.prepare(tmp_path)
    trainer.train_step()  # residual networks start with 0
    index, coins = trainer.order.frames(1), trainer.order.coins(1)
    assert len(trainer.train_frames.by_outfit(index)) == 2
    weights = list(trainer.model.parameters())
    sums = [torch.zeros_like(weight) for weight in weights]
    losses = np.zeros(2)
    for frame, coin in zip(index, coins, strict=True):
        ((number, _),) = trainer.train_frames.by_outfit(frame[None])
        both = trainer._losses(number, frame[None], coin[None])
        losses += [loss.item() / len(index) for loss in both]
        gradients = torch.autograd.grad(both[0] + both[1], weights, allow_unused=True)
        for total, gradient in zip(sums, gradients, strict=True):
            total.add_(0 if gradient is None else gradient / len(index))
    found = trainer.train_step()
    assert [found["position_loss"], found["normal_loss"]] == pytest.approx(losses, rel=1e-5)
    for weight, total in zip(weights, sums, strict=True):
        assert weight.grad is not None
        torch.testing.assert_close(weight.grad, total, rtol=1e-3, atol=1e-6)


def test_a_run_on_several_garments_goes_on_as_if_it_had_not_stopped(
    wardrobe: Path, general: Path, tmp_path: Path
) -> None:
    trainer = Trainer(local_config(wardrobe, steps=3))
    trainer.prepare(tmp_path)
    trainer.train_step()
    trainer.save(tmp_path)
    again = Trainer(local_config(wardrobe, steps=3))
    again.load(tmp_path)
    again.prepare(tmp_path)
    again.train_step()
    again.train_step()
    known = load_model(general).state_dict()
    assert all(torch.equal(value, known[name]) for name, value in again.model.state_dict().items())


def test_constants_of_few_outfits_are_kept(
    wardrobe: Path, general: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outfits, "KEPT", 1)
    trainer = Trainer(local_config(wardrobe, steps=3))
    trainer.prepare(tmp_path)
    for _ in range(3):
        trainer.train_step()
        assert len(trainer._outfits[id(trainer.train_frames)]._kept) == 1
    known = load_model(general).state_dict()
    assert all(torch.equal(value, known[name]) for name, value in trainer.model.state_dict().items())


def test_a_general_model_dresses_a_template_and_a_body_that_it_has_not_seen(general: Path) -> None:
    header = read_tensors(general / "model.safetensors", "imgtransfer-model")[1]
    assert header["general"] is True
    assert header["maps"]["views"] == ["front", "back"]  # no template's elevations
    model, clip = load_model(general), tube_clip(3, **UNSEEN)
    prediction = model.predict(clip)
    assert np.array_equal(prediction.imager.mesh.faces, clip.template.faces)
    own = TransferModel(
        maps=model.asked,
        network=model.network,
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=model.box,
        body=Mesh(clip.body.rest, clip.body.faces),
    )
    own.load_state_dict(model.state_dict())
    own.mirrored_average = True
    assert torch.equal(own.eval().predict(clip).positions, prediction.positions)
    covered = prediction.imager.mask.expand(prediction.positions.shape[:-1])
    near = (
        prediction.metres()[covered]
        - prediction.imager.operator(torch.from_numpy(prediction.frames.to_canonical(clip.garment.vertices)))[
            covered
        ]
    )
    assert near.norm(dim=-1).max() < 0.1  # metres: three steps from the first guess


def test_predict_writes_maps_and_vertices_of_the_garment_in_the_source(general: Path, tmp_path: Path) -> None:
    clip = tube_clip(3, name="unseen", **UNSEEN)
    save_clip(tmp_path / "unseen.npz", replace(clip, garment=None))
    out = tmp_path / "out"
    assert main(["predict", str(general), str(tmp_path / "unseen.npz"), "--out", str(out)]) == 0
    maps = load_maps(out / "unseen" / "maps.npz")
    assert np.array_equal(maps.template_faces, clip.template.faces)
    written = load_clip(out / "unseen" / "position_only.npz")
    assert written.garment is not None
    assert written.garment.vertices.shape == clip.garment.vertices.shape
    assert main(["fuse", str(out)]) == 0


def test_networks_that_see_images_train_on_one_garment(wardrobe: Path) -> None:
    with pytest.raises(InputError, match=r"second: its garment_faces differ .* unless network.body is local"):
        Trainer(small_config(wardrobe))


def test_a_run_on_one_garment_is_not_validated_on_another(wardrobe: Path) -> None:
    config = local_config(wardrobe).model_dump(mode="json", exclude_unset=True)
    config["data"]["train"] = {"split": None, "names": ["first"]}
    with pytest.raises(InputError, match=r"second_test: its garment .* is not the model's"):
        Trainer(parse_config(RunConfig, config, "run"))


def test_a_header_that_says_general_of_such_networks_is_refused(source: Path, tmp_path: Path) -> None:
    train(small_config(source, steps=1), tmp_path / "run")
    tensors, header = read_tensors(tmp_path / "run" / "model.safetensors", "imgtransfer-model")
    write_tensors(tmp_path / "odd.safetensors", tensors, header | {"general": True})
    with pytest.raises(
        InputError, match=r"odd.safetensors: not a model .* \(general is True with body: images"
    ):
        load_model(tmp_path / "odd.safetensors")


def test_a_general_model_begins_a_run_on_one_garment(
    source: Path, general: Path, tube_clip: Clip, tmp_path: Path
) -> None:
    trainer = Trainer(local_config(source, init=str(general)))
    known = load_model(general)
    assert not trainer.model.general
    for name, value in known.state_dict().items():
        assert torch.equal(trainer.model.state_dict()[name], value)
    trainer.save(tmp_path)
    assert not load_model(tmp_path).general
    assert torch.allclose(
        load_model(tmp_path).predict(tube_clip).metres(), known.predict(tube_clip).metres(), atol=1e-5
    )


def test_a_model_of_one_garment_does_not_begin_a_run_on_several(
    source: Path, wardrobe: Path, tmp_path: Path
) -> None:
    train(local_config(source, steps=1), tmp_path / "run")
    with pytest.raises(InputError, match="this model was trained on one garment, and the run has 2"):
        Trainer(local_config(wardrobe, init=str(tmp_path / "run")))


def test_other_views_than_a_general_model_s_are_refused(source: Path, general: Path) -> None:
    config = local_config(source, init=str(general)).model_dump(mode="json", exclude_unset=True)
    config["maps"] = SMALL["maps"] | {"views": ["front"]}
    with pytest.raises(
        InputError, match=r"trained with maps.views \['front', 'back'\], and the run has \['front'\]"
    ):
        Trainer(parse_config(RunConfig, config, "run"))


def test_outfits_follow_each_other_in_packs_and_every_frame_comes_once_an_epoch() -> None:
    groups = list(torch.arange(60).split([12, 24, 8, 16]))
    order = Order(60, 4, 5, groups=groups)
    epoch = torch.cat([order.frames(step) for step in range(15)])
    assert sorted(epoch.tolist()) == list(range(60))
    of = torch.repeat_interleave(torch.arange(4), torch.tensor([12, 24, 8, 16]))
    packs = of[epoch].view(-1, PACK)
    assert (packs == packs[:, :1]).all()
    assert (packs[:-1, 0] != packs[1:, 0]).sum() > 4  # the outfits are mixed
    same = Order(60, 4, 5, groups=groups)
    assert torch.equal(order.frames(40), same.frames(40))
    assert not torch.equal(epoch, torch.cat([order.frames(step) for step in range(15, 30)]))


def test_a_head_is_fitted_to_what_a_trained_model_leaves(source: Path, general: Path, tmp_path: Path) -> None:
    tensors, header = read_tensors(general / "model.safetensors", "imgtransfer-model")
    torch.manual_seed(3)
    for part in ("position_net", "normal_net"):  # a model that says something else than the first guess
        tensors[f"model.{part}.to_patch.weight"].normal_(std=0.05)
    write_tensors(tmp_path / "general.safetensors", tensors, header)
    config = local_config(source, init=str(tmp_path / "general.safetensors"), mirror=True)
    content = config.model_dump(mode="json", exclude_unset=True)
    content["training"]["steps"] = 0
    content["network"] = LOCAL | {"head": {"kind": "kernel", "patches": 3, "ridge": 1e-6}}
    config = parse_config(RunConfig, content, "run")
    trainer = Trainer(config)
    without = trainer.validate()  # on frames that are among the training's
    trainer.fit_head()
    with_head = trainer.validate()
    assert with_head["position_mm"] < 0.1 * without["position_mm"]
    assert with_head["normal_degrees"] < 0.3 * without["normal_degrees"]
    train(config, tmp_path / "run")
    assert load_model(tmp_path / "run").head is not None
