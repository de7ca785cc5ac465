"""The kernel head: fitted to frames, left out of them, stored, resumed, and used by the networks and by predictions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config, to_yaml
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.network.base import Guess
from imgtransfer.network.local_view import mirrored_features
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.training.checkpoint import load_model, read_tensors, save_model, write_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.divergence import Diverged
from imgtransfer.training.head_fit import principal, turned_back
from imgtransfer.training.loop import train
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.training import head_config


@pytest.fixture(scope="module")
def clips(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clips to train on, and one that is part of the first to validate."""
    folder = tmp_path_factory.mktemp("clips")
    save_clip(folder / "first.npz", tube_clip)
    save_clip(folder / "later.npz", tube_clip.slice(slice(1, 4)))
    save_clip(folder / "second_test.npz", tube_clip.slice(slice(2, 5)))
    return folder


@pytest.fixture(scope="module")
def fitted(clips: Path) -> Trainer:
    """Read only."""
    trainer = Trainer(head_config(clips))
    trainer.fit_head()
    return trainer


@pytest.fixture(scope="module")
def alone(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run without any steps: read only."""
    folder = tmp_path_factory.mktemp("alone") / "run"
    train(head_config(clips, steps=0, stored="float16"), folder)
    return folder


def test_a_head_that_is_hardly_regularised_meets_the_frames_it_was_fitted_to(
    fitted: Trainer, clips: Path
) -> None:
    without = Trainer(head_config(clips)).validate()
    with_head = fitted.validate()  # on frames that are among the training's
    assert with_head["guess_position_mm"] < 0.1 * without["guess_position_mm"]
    assert with_head["guess_normal_degrees"] < 0.2 * without["guess_normal_degrees"]


def test_training_frames_have_the_guess_of_a_head_that_has_not_seen_their_clip(
    fitted: Trainer, clips: Path, tube_clip: Clip, tmp_path: Path
) -> None:
    """A garment that is 10 cm off in one clip moves the guess of the others, and none in that clip's own frames."""
    assert tube_clip.garment is not None
    off = replace(tube_clip.garment, vertices=tube_clip.garment.vertices + np.float32([0, 0, 0.1]))
    save_clip(tmp_path / "first.npz", tube_clip)
    save_clip(tmp_path / "later.npz", replace(tube_clip, garment=off).slice(slice(1, 4)))
    save_clip(tmp_path / "second_test.npz", tube_clip.slice(slice(2, 5)))
    other = Trainer(head_config(tmp_path))
    other.fit_head()
    frames = torch.arange(len(fitted.train_frames))
    guesses = [trainer.batch(trainer.train_frames, frames)[0].guess for trainer in (fitted, other)]
    assert guesses[0] is not None
    assert guesses[1] is not None
    moved = (guesses[1].positions - guesses[0].positions)[:, fitted.model.mask].norm(dim=-1).mean(-1)
    later = frames >= tube_clip.n_frames
    assert moved[later].max() < 0.003
    assert moved[~later].min() > 0.05


def test_a_rigid_motion_of_the_body_changes_no_residual(fitted: Trainer, tube_clip: Clip) -> None:
    head, imager = fitted.model.head, fitted.model.body_imager(tube_clip)
    assert head is not None
    assert imager.view is not None
    turn = Rotation.from_rotvec([0.5, -0.9, 0.7]).as_matrix().astype(np.float32)
    bodies = torch.from_numpy(tube_clip.body.vertices[2:4].astype(np.float32))
    there = []
    for move in (lambda v: v, lambda v: v @ torch.from_numpy(turn).T + torch.tensor([0.2, -0.1, 0.4])):
        now, before = move(bodies[1:]), move(bodies[:1])
        local = imager(now, earlier=imager.view.samples(before)[:, None]).local
        assert local is not None
        there.append(head(local))
    for first, second in zip(*there, strict=True):
        assert first.abs().max() > 1e-3
        torch.testing.assert_close(first, second, rtol=0, atol=1e-4)


def test_a_batch_equals_its_singles(fitted: Trainer) -> None:
    frames = torch.tensor([0, 7, 3, 5])
    guess = fitted.batch(fitted.train_frames, frames)[0].guess
    assert guess is not None
    for row, frame in enumerate(frames):
        single = fitted.batch(fitted.train_frames, frame[None])[0].guess
        assert single is not None
        torch.testing.assert_close(guess.positions[row], single.positions[0], rtol=0, atol=1e-5)
        torch.testing.assert_close(guess.normals[row], single.normals[0], rtol=0, atol=1e-4)


def test_its_products_are_not_rounded_where_the_networks_are(fitted: Trainer) -> None:
    head, body = fitted.model.head, fitted.batch(fitted.train_frames, torch.arange(4))[0]
    assert head is not None
    assert body.local is not None
    alone = head(body.local)
    with torch.autocast("cpu", torch.bfloat16):
        among_networks = head(body.local)
    for one, other in zip(alone, among_networks, strict=True):
        assert torch.equal(one, other)


def test_one_and_two_threads_fit_the_same(fitted: Trainer, clips: Path) -> None:
    again = Trainer(head_config(clips, threads=2))
    again.fit_head()
    torch.set_num_threads(1)
    bodies = [t.batch(t.validation_frames, torch.arange(3))[0].guess for t in (fitted, again)]
    assert bodies[0] is not None
    assert bodies[1] is not None
    torch.testing.assert_close(bodies[0].positions, bodies[1].positions, rtol=0, atol=1e-5)


def test_a_run_without_steps_predicts_the_heads_guess(alone: Path, clips: Path, tube_clip: Clip) -> None:
    trainer = Trainer(load_config(RunConfig, alone / "config.yaml"))
    trainer.load(alone)
    model = load_model(alone)  # stored as float16
    predicted = model.predict(tube_clip).metres()
    body, _ = trainer.batch(trainer.validation_frames, torch.arange(3))
    assert body.guess is not None
    kept = model.mask
    # From the same frames, which the validation clip begins with no earlier ones for: all but its first.
    torch.testing.assert_close(predicted[4:5][:, kept], body.guess.positions[2:3][:, kept], rtol=0, atol=2e-3)


def test_float16_files_lose_nothing_that_matters(fitted: Trainer, tube_clip: Clip, tmp_path: Path) -> None:
    paths = [
        save_model(tmp_path / f"{stored}.safetensors", fitted.model, stored=stored)
        for stored in ("float32", "float16")
    ]
    exact, rounded = (load_model(path).predict(tube_clip).metres() for path in paths)
    torch.testing.assert_close(rounded, exact, rtol=0, atol=5e-4)


def test_a_resumed_run_is_the_same_run(clips: Path, tmp_path: Path) -> None:
    train(head_config(clips, steps=4), tmp_path / "whole")
    train(head_config(clips, steps=2), tmp_path / "parts")
    train(head_config(clips, steps=4), tmp_path / "parts", resume=True)
    whole, _ = read_tensors(tmp_path / "whole" / "model.safetensors", "imgtransfer-model")
    parts, _ = read_tensors(tmp_path / "parts" / "model.safetensors", "imgtransfer-model")
    assert any(key.startswith("model.head.") for key in whole)
    assert whole.keys() == parts.keys()
    for key, value in whole.items():
        torch.testing.assert_close(parts[key], value, rtol=0, atol=0)


@pytest.mark.parametrize("name", ["model.head.weights", "model.head.mean"])
def test_a_model_whose_head_is_damaged_is_one_line(alone: Path, tmp_path: Path, name: str) -> None:
    tensors, header = read_tensors(alone / "model.safetensors", "imgtransfer-model")
    for damaged in (None, tensors[name][..., :1]):
        changed = {key: value for key, value in tensors.items() if key != name}
        if damaged is not None:
            changed[name] = damaged
        write_tensors(tmp_path / "damaged.safetensors", changed, header)
        with pytest.raises(InputError, match=r"those of network\.head do not fit it") as error:
            load_model(tmp_path / "damaged.safetensors")
        assert "\n" not in str(error.value)


def test_a_state_without_the_heads_of_left_out_clips_is_one_line(alone: Path, tmp_path: Path) -> None:
    tensors, header = read_tensors(alone / "state.safetensors", "imgtransfer-training-state")
    del tensors["left_out.weights"]
    write_tensors(tmp_path / "state.safetensors", tensors, header)
    trainer = Trainer(load_config(RunConfig, alone / "config.yaml"))
    with pytest.raises(InputError, match="the heads of its left-out clips do not fit"):
        trainer.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("network.body=images", "head.kind: kernel needs body: local"),
        ("network.head.kind=none", "training.steps: 0 needs network.head.kind: kernel"),
        ("network.head.support=0", "network.head.support: a whole number from 1"),
        ("network.head.kind=linear", "network.head.kind"),
    ],
)
def test_bad_configs_are_one_clear_line(clips: Path, tmp_path: Path, change: str, message: str) -> None:
    (tmp_path / "run.yaml").write_text(to_yaml(head_config(clips, steps=0)))
    with pytest.raises(InputError, match=message) as error:
        load_config(RunConfig, tmp_path / "run.yaml", [change, "network.history_s=[]"])
    assert "\n" not in str(error.value)


def test_what_it_predicts_is_fused(clips: Path, alone: Path, tmp_path: Path) -> None:
    assert main(["predict", str(alone), str(clips / "first.npz"), "--out", str(tmp_path / "out")]) == 0
    assert main(["fuse", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "first" / "fused.npz").exists()


def test_the_mirrored_average_is_the_mean_with_what_the_mirrored_scene_gets(fitted: Trainer) -> None:
    head, local = fitted.model.head, fitted.batch(fitted.train_frames, torch.arange(3))[0].local
    assert head is not None
    assert local is not None
    sign = torch.tensor([-1.0, 1.0, 1.0])
    mask = fitted.model.mask
    both = mask & mask.flip(-1)  # elsewhere the nearest pixel of the mirror image counts
    parts = head(local), head(mirrored_features(local)), head(local, mirrored=True)
    for plain, other, mean in zip(*parts, strict=True):
        assert (other - plain).abs().max() > 1e-3
        expected = (plain + other.flip(3) * sign) / 2
        torch.testing.assert_close(mean[:, both], expected[:, both], rtol=0, atol=1e-5)


def test_a_model_that_averages_gets_the_mirrored_guess_for_the_mirrored_body(clips: Path) -> None:
    trainer = Trainer(head_config(clips, mirror=True))
    trainer.fit_head()
    model, body = trainer.model, trainer.batch(trainer.validation_frames, torch.arange(3))[0]
    head = model.head
    assert head is not None
    assert body.local is not None
    assert body.guess is not None
    averaged = head(body.local, mirrored=True)[0]
    other = head(mirrored_features(body.local), mirrored=True)[0].flip(3) * torch.tensor([-1.0, 1.0, 1.0])
    both = model.mask & model.mask.flip(-1)
    torch.testing.assert_close(other[:, both], averaged[:, both], rtol=0, atol=1e-4)
    model.mirrored_average = False
    alone = trainer.batch(trainer.validation_frames, torch.arange(3))[0].guess
    assert alone is not None
    moved = (body.guess.positions - alone.positions)[:, model.mask]
    expected = (averaged - head(body.local)[0])[:, model.mask]
    torch.testing.assert_close(moved.norm(dim=-1), expected.norm(dim=-1), rtol=0.02, atol=1e-4)


def test_all_frames_bear_half_the_length_that_the_choice_begins_with(fitted: Trainer, clips: Path) -> None:
    unchosen = Trainer(head_config(clips, head={"choice_steps": 0}))
    unchosen.fit_head()
    assert fitted.model.head is not None
    assert unchosen.model.head is not None
    torch.testing.assert_close(unchosen.model.head.width, 4 * fitted.model.head.width)


def test_directions_by_hand() -> None:
    samples = torch.tensor([[3.0, 0, 0], [-3, 0, 0], [0, 1, 0], [0, -1, 0]])
    torch.testing.assert_close(principal(samples, 3).abs(), torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]]))


def test_turning_back_undoes_turning() -> None:
    rotation = torch.from_numpy(Rotation.random(60, random_state=0).as_matrix()).float()
    guess = Guess(torch.zeros(3, 2, 2, 5, 3), torch.zeros(3, 2, 2, 5, 3), rotation.view(3, 2, 2, 5, 3, 3))
    vectors = torch.randn(3, 2, 2, 5, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(turned_back(guess, guess.turn(vectors)), vectors, rtol=0, atol=1e-5)
    blended = replace(guess, rotation=0.9 * guess.rotation if guess.rotation is not None else None)
    torch.testing.assert_close(turned_back(blended, blended.turn(vectors)), vectors, rtol=0, atol=1e-2)
    axes_lost = replace(guess, rotation=torch.zeros_like(rotation).view(3, 2, 2, 5, 3, 3))
    assert turned_back(axes_lost, vectors).abs().max() == 0


def test_a_head_that_would_not_be_finite_is_refused(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer = Trainer(head_config(clips))
    real = trainer.batch

    def batch(frames: Frames, index: torch.Tensor) -> tuple[BodyMaps, ImagePair]:
        body, truth = real(frames, index)
        return body, ImagePair(truth.positions * torch.nan, truth.normals)

    monkeypatch.setattr(trainer, "batch", batch)
    with pytest.raises(Diverged, match=r"network.head cannot be fitted.*try another network.head.ridge"):
        trainer.fit_head()
    assert trainer.model.head is None
