"""A kernel head that reads what trained networks make of the frames: what it reads, fits, stores and predicts."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from imgtransfer.cli.main import main
from imgtransfer.config.loader import to_yaml
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.network.kernel_head import KernelHead
from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.local_view import TemplateView
from imgtransfer.training.checkpoint import load_model, read_tensors, save_model, write_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.head_choice import READ
from imgtransfer.training.head_fit import beside
from imgtransfer.training.loop import train
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.training import head_config


@pytest.fixture(scope="module")
def clips(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    save_clip(folder / "first.npz", tube_clip)
    save_clip(folder / "later.npz", tube_clip.slice(slice(1, 4)))
    save_clip(folder / "second_test.npz", tube_clip.slice(slice(2, 5)))
    return folder


@pytest.fixture(scope="module")
def begun(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A general model to begin with, whose networks say something."""
    folder = tmp_path_factory.mktemp("begun")
    trainer = Trainer(head_config(clips, head={"kind": "none"}))
    torch.manual_seed(1)
    for net in (trainer.model.position_net, trainer.model.normal_net):
        assert isinstance(net, LocalTransferNet)
        torch.nn.init.normal_(net.to_patch.weight, std=0.05)
    trainer.save(folder)
    tensors, header = read_tensors(folder / "model.safetensors", "imgtransfer-model")
    return write_tensors(folder / "general.safetensors", tensors, header | {"general": True})


def reading(clips: Path, begun: Path, **training: object) -> RunConfig:
    return head_config(clips, init=str(begun), **({"steps": 0, "mirror": True} | training))


@pytest.fixture(scope="module")
def fitted(clips: Path, begun: Path) -> Trainer:
    """Read only."""
    trainer = Trainer(reading(clips, begun))
    trainer.fit_head()
    return trainer


@pytest.fixture(scope="module")
def run(clips: Path, begun: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run: read only."""
    folder = tmp_path_factory.mktemp("reading") / "run"
    train(reading(clips, begun, stored="float16"), folder)
    return folder


def head_of(trainer: Trainer) -> KernelHead:
    assert trainer.model.head is not None
    return trainer.model.head


def guessed(trainer: Trainer) -> Tensor:
    """Of the validation frames, metres at the silhouette."""
    guess = trainer.batch(trainer.validation_frames, torch.arange(3))[0].guess
    assert guess is not None
    return guess.positions[:, trainer.model.mask]


def test_it_reads_what_the_last_layers_do_of_the_frames_and_of_the_mirrored_ones(fitted: Trainer) -> None:
    seen: list[Tensor] = []
    networks = (fitted.model.position_net, fitted.model.normal_net)
    hooks = [
        net.to_patch.register_forward_pre_hook(lambda _, given: seen.append(given[0])) for net in networks
    ]
    index = torch.tensor([1, 4])
    fitted.model.eval()
    with torch.no_grad():
        frames = fitted._shown_to_head(index)
    for hook in hooks:
        hook.remove()
    assert len(frames.read) == 2
    garment = fitted._outfit(fitted.train_frames, index).garment
    assert isinstance(garment, TemplateView)
    covered = garment.covered[0]
    # The position network and the normal network of the frames, then both of the mirrored ones.
    for read, parts, where in zip(
        frames.read, (seen[:2], seen[2:4]), (covered, covered.flip(-1)), strict=True
    ):
        torch.testing.assert_close(read[:, where], torch.cat(parts, dim=-1), rtol=0, atol=1e-5)
        assert not read[:, ~where].any()


def test_what_is_read_stands_beside_the_body_by_hand() -> None:
    body = torch.tensor([[0.0], [2.0], [4.0]])  # squared distances 4, 4 and 16
    read = torch.tensor([[0.0, 0], [0, 10], [0, 20]])  # 100, 100, 400
    assert beside(body, read) == pytest.approx((READ * 4 / 100) ** 0.5)


def test_a_head_that_reads_meets_the_frames_it_was_fitted_to(fitted: Trainer, clips: Path) -> None:
    assert head_of(fitted).reads
    without, with_head = Trainer(head_config(clips, mirror=True)).validate(), fitted.validate()
    assert with_head["position_mm"] < 0.1 * without["position_mm"]


def test_what_it_reads_changes_what_it_predicts(fitted: Trainer, clips: Path, begun: Path) -> None:
    other = Trainer(reading(clips, begun))
    other.fit_head()
    torch.testing.assert_close(guessed(other), guessed(fitted), rtol=0, atol=0)
    with torch.no_grad():
        head_of(other).read_axes.zero_()
    assert (guessed(other) - guessed(fitted)).abs().max() > 1e-4


def test_networks_that_say_nothing_leave_the_head_as_it_is_without_them(
    clips: Path, begun: Path, tmp_path: Path
) -> None:
    tensors, header = read_tensors(begun, "imgtransfer-model")
    for part in ("position_net", "normal_net"):
        for name in ("norm.weight", "norm.bias", "to_patch.weight", "to_patch.bias"):
            tensors[f"model.{part}.{name}"].zero_()
    write_tensors(tmp_path / "silent.safetensors", tensors, header)
    beside_them, alone = (
        Trainer(config)
        for config in (
            reading(clips, tmp_path / "silent.safetensors"),
            head_config(clips, steps=0, mirror=True),
        )
    )
    for trainer in (beside_them, alone):
        trainer.fit_head()
    assert head_of(beside_them).reads
    assert not head_of(alone).reads
    torch.testing.assert_close(guessed(beside_them), guessed(alone), rtol=0, atol=2e-5)


def test_a_model_of_such_a_run_predicts_what_the_run_does(
    run: Path, clips: Path, begun: Path, tube_clip: Clip
) -> None:
    trainer = Trainer(reading(clips, begun, stored="float16"))
    trainer.load(run)
    trainer.model.eval()
    model = load_model(run)
    assert model.head is not None
    assert model.head.reads
    predicted = model.predict(tube_clip).metres()[4][model.mask]
    images = trainer.images(torch.tensor([2]))[0]
    torch.testing.assert_close(
        predicted, trainer.model.box.decode(images.predicted.positions)[0][model.mask], rtol=0, atol=2e-3
    )


def test_a_resumed_fit_is_the_whole_fit(run: Path, clips: Path, begun: Path, fitted: Trainer) -> None:
    before = (run / "model.safetensors").read_bytes()
    train(reading(clips, begun, stored="float16"), run, resume=True)
    assert (run / "model.safetensors").read_bytes() == before
    trainer = Trainer(reading(clips, begun))
    trainer.load(run)
    torch.testing.assert_close(guessed(trainer), guessed(fitted), rtol=0, atol=0)


def test_a_batch_equals_its_singles(clips: Path, begun: Path) -> None:
    # Hardly regularised, it would enlarge what products of other sizes round differently.
    head = {"ridge": 1e-2, "choice_steps": 0}
    fitted = Trainer(head_config(clips, head=head, init=str(begun), steps=0, mirror=True))
    fitted.fit_head()
    together = fitted.batch(fitted.train_frames, torch.tensor([0, 7, 3]))[0].guess
    assert together is not None
    for row, frame in enumerate((0, 7, 3)):
        single = fitted.batch(fitted.train_frames, torch.tensor([frame]))[0].guess
        assert single is not None
        torch.testing.assert_close(together.positions[row], single.positions[0], rtol=0, atol=1e-5)


def test_networks_that_are_trained_on_are_not_read(clips: Path, begun: Path) -> None:
    trainer = Trainer(reading(clips, begun, steps=2))
    trainer.fit_head()
    assert not head_of(trainer).reads


def test_a_file_of_float16_loses_nothing_that_matters(
    fitted: Trainer, tube_clip: Clip, tmp_path: Path
) -> None:
    paths = [
        save_model(tmp_path / f"{stored}.safetensors", fitted.model, stored=stored)
        for stored in ("float32", "float16")
    ]
    exact, rounded = (load_model(path).predict(tube_clip).metres() for path in paths)
    torch.testing.assert_close(rounded, exact, rtol=0, atol=5e-4)


def test_steps_on_top_of_a_head_that_reads_are_one_line(
    run: Path, clips: Path, begun: Path, tmp_path: Path
) -> None:
    (tmp_path / "more.yaml").write_text(to_yaml(reading(clips, begun, stored="float16", steps=2)))
    trainer = Trainer(reading(clips, begun, stored="float16", steps=2))
    with pytest.raises(InputError, match=r"reads the networks as they are.*choose another out") as error:
        trainer.load(run)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["read_mean", "read_axes"])
def test_a_model_without_what_it_reads_by_is_one_line(run: Path, tmp_path: Path, name: str) -> None:
    tensors, header = read_tensors(run / "model.safetensors", "imgtransfer-model")
    value = tensors.pop(f"model.head.{name}")
    write_tensors(tmp_path / "without.safetensors", tensors, header)
    write_tensors(tmp_path / "cut.safetensors", tensors | {f"model.head.{name}": value[:, :1]}, header)
    for file in ("without", "cut"):
        with pytest.raises(InputError, match=r"those of network\.head do not fit it"):
            load_model(tmp_path / f"{file}.safetensors")


def test_single_frames_and_no_mirrored_average_predict(run: Path, clips: Path, tmp_path: Path) -> None:
    command = [
        "predict",
        str(run),
        str(clips / "first.npz"),
        "--out",
        str(tmp_path / "out"),
        "--no-mirrored-average",
    ]
    assert main(command) == 0
