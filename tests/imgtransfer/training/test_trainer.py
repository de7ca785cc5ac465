"""Training: configurations, the order of frames, one step, resuming, checkpoints."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config, parse_config, to_yaml
from imgtransfer.data.clip import Clip
from imgtransfer.network import TransferModel, masked_l1
from imgtransfer.network.encoder_config import HubEncoderConfig
from imgtransfer.network.maps import metric_maps
from imgtransfer.training.checkpoint import load_model, save_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.loop import train
from imgtransfer.training.optimizer import learning_rate
from imgtransfer.training.order import Order
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.paths import ROOT
from tests.helpers.training import small_config

CONFIGS = ROOT / "configs"


@pytest.fixture(scope="module")
def whole(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of `small_config`, trained to its end: read only."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    train(small_config(source), folder)
    return folder


def weights(folder: Path) -> dict[str, torch.Tensor]:
    return load_file(folder / "state.safetensors")


@pytest.mark.parametrize("name", sorted(path.name for path in CONFIGS.glob("*.yaml")))
def test_every_config_loads_and_reads_back(name: str, tmp_path: Path) -> None:
    config = load_config(RunConfig, CONFIGS / name)
    (tmp_path / "again.yaml").write_text(to_yaml(config))
    assert load_config(RunConfig, tmp_path / "again.yaml") == config


def test_the_papers_config_has_the_papers_sizes() -> None:  # section 4.2, appendix C
    config = load_config(RunConfig, CONFIGS / "paper.yaml")
    assert (config.maps.size, config.maps.root) == ((256, 256), "root")
    encoder, network = config.network.encoder, config.network
    assert encoder == HubEncoderConfig(name="facebook/dino-vitb16", trained_blocks=2)
    assert (network.blocks, network.heads, config.training.optimizer) == (4, 4, "adam")
    assert (config.training.steps, config.training.learning_rate) == (100_000, 1e-4)
    assert (config.network.target, config.network.shortcuts) == ("absolute", False)


@pytest.mark.parametrize(
    ("text", "changes", "message"),
    [
        (
            "data: {source: x}\ntraining: {step: 5}",
            (),
            "training.step: no such setting of training, did you mean steps",
        ),
        ("maps: {}", (), "run.yaml: data: missing"),
        (
            "data: {source: x}",
            ("training.steps=-1",),
            "changes training.steps=-1: training.steps: a whole number from 0 to 1e.09",
        ),
        ("data: {source: x}", ("training.steps",), "section.key=value is wanted"),
        ("data: {source: x}", ("data.source.y=1",), "changes data.source.y=1: .* is not a section"),
        ("data: [", (), "not YAML"),
        ("just text", (), "a mapping of settings is wanted, found only 'just text'"),
    ],
)
def test_bad_configs_are_one_clear_line(
    tmp_path: Path, text: str, changes: tuple[str, ...], message: str
) -> None:
    (tmp_path / "run.yaml").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_config(RunConfig, tmp_path / "run.yaml", changes)
    assert "\n" not in str(error.value)


def test_changes_replace_values(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("data: {source: x}")
    config = load_config(
        RunConfig, tmp_path / "run.yaml", ["training.steps=7", "maps.size=[64, 32]", "data.source=y"]
    )
    assert (config.training.steps, config.maps.size, config.data.source) == (7, (64, 32), Path("y"))


def test_every_frame_comes_once_before_any_comes_again() -> None:
    order = Order(5, 2, seed=3)
    shown = torch.cat([order.frames(step) for step in range(5)]).tolist()
    assert sorted(shown[:5]) == sorted(shown[5:]) == list(range(5))
    assert shown[:5] != shown[5:]


def test_a_steps_frames_do_not_depend_on_the_steps_before() -> None:
    walked = Order(5, 2, seed=3)
    frames = [walked.frames(step) for step in range(9)]
    assert torch.equal(Order(5, 2, seed=3).frames(8), frames[8])
    assert not torch.equal(torch.cat(frames), torch.cat([Order(5, 2, seed=4).frames(s) for s in range(9)]))


def test_learning_rate_warms_up_and_falls() -> None:
    options = parse_config(
        RunConfig,
        {
            "data": {"source": "x"},
            "training": {"steps": 12, "warmup_steps": 2, "learning_rate": 0.5, "schedule": "cosine"},
        },
        "",
    ).training
    rates = [learning_rate(options, step) for step in range(12)]
    assert rates[:3] == [0.25, 0.5, 0.5]
    assert rates[7] == pytest.approx(0.25)  # half-way between step 2 and step 12
    assert 0 < rates[11] < 0.02


def test_a_training_step_lowers_the_loss_of_its_frames(source: Path) -> None:
    trainer = Trainer(small_config(source, mirror=False, batch_frames=6, learning_rate=1e-4))
    first = trainer.train_step()
    second = trainer.train_step()  # all six frames again
    assert second["position_loss"] < first["position_loss"]
    assert second["normal_loss"] < first["normal_loss"]


def test_validation_is_in_float32_as_prediction_is(source: Path) -> None:
    measured = []
    for precision in ("float32", "bfloat16"):
        trainer = Trainer(small_config(source, mirror=True, precision=precision))
        with torch.no_grad():  # networks begin with the first guess alone
            for parameter in trainer.model.parameters():
                parameter.add_(0.01)
        measured.append(trainer.validate())
    assert trainer.precision.name == "bfloat16"
    assert measured[0] == measured[1]
    assert measured[0]["position_mm"] != measured[0]["guess_position_mm"]


def test_training_beats_the_first_guess(source: Path) -> None:
    trainer = Trainer(small_config(source, mirror=False, steps=60, learning_rate=2e-3))
    for _ in range(60):
        trainer.train_step()
    errors = trainer.validate()
    assert errors["position_mm"] < 0.8 * errors["guess_position_mm"]
    assert errors["normal_degrees"] < errors["guess_normal_degrees"]


def test_the_same_seed_gives_the_same_weights(source: Path, whole: Path, tmp_path: Path) -> None:
    train(small_config(source), tmp_path / "again")
    train(small_config(source, seed=1), tmp_path / "other")
    a, b, c = (weights(folder) for folder in (whole, tmp_path / "again", tmp_path / "other"))
    assert all(torch.equal(a[key], b[key]) for key in a)
    assert any(not torch.equal(a[key], c[key]) for key in a)


def test_resume_continues_bit_for_bit(
    config: RunConfig, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Trainer.train_step

    def interrupted(self: Trainer) -> dict[str, float]:
        if self.step == 3:  # Ctrl-C during the fourth step
            os.kill(os.getpid(), signal.SIGINT)
        return original(self)

    monkeypatch.setattr(Trainer, "train_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "parts")
    monkeypatch.undo()
    train(config, tmp_path / "parts", resume=True)
    wanted, found = weights(whole), weights(tmp_path / "parts")
    assert wanted.keys() == found.keys()
    assert any(key.startswith("optimizer.") for key in wanted)
    assert all(torch.equal(wanted[key], found[key]) for key in wanted)
    logs = [
        [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
        for folder in (whole, tmp_path / "parts")
    ]
    for entry in (entry for log in logs for entry in log):
        del entry["seconds"]
        entry.pop("precision", None)  # the first line that a process writes says it
    assert logs[0] == logs[1]


def test_a_run_stopped_before_its_first_step_goes_on(
    config: RunConfig, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Trainer.validate

    def interrupt(trainer: Trainer) -> dict[str, float]:
        os.kill(os.getpid(), signal.SIGINT)
        return real(trainer)

    monkeypatch.setattr(Trainer, "validate", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "run")
    monkeypatch.undo()
    train(config, tmp_path / "run", resume=True)
    stopped, wanted = weights(tmp_path / "run"), weights(whole)
    assert all(torch.equal(stopped[key], wanted[key]) for key in wanted)


def test_resuming_another_configuration_is_refused(
    config: RunConfig, source: Path, whole: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"holds a run already; add resume=True"):
        train(config, whole)
    with pytest.raises(InputError, match=r"cannot resume, training.batch_frames is 3 now and was 2"):
        train(small_config(source, batch_frames=3), whole, resume=True)
    with pytest.raises(InputError, match="no run to resume"):
        train(config, tmp_path / "other", resume=True)
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("stored", ["float32", "float16"])
def test_a_stored_model_predicts_as_before(
    config: RunConfig, tube_clip: Clip, tmp_path: Path, stored: str
) -> None:
    trainer = Trainer(config)
    trainer.train_step()
    save_model(tmp_path / "model.safetensors", trainer.model, stored=stored)
    loaded = load_model(tmp_path)
    before, after = trainer.model.eval().predict(tube_clip), loaded.predict(tube_clip)
    tolerance = {"float32": 0.0, "float16": 2e-3}[stored]  # 2e-3: float16 has 11 bits, over a few layers
    torch.testing.assert_close(after.positions, before.positions, rtol=0, atol=tolerance)
    torch.testing.assert_close(after.normals, before.normals, rtol=0, atol=10 * tolerance)
    assert np.array_equal(loaded.imager.mesh.vertices, trainer.model.imager.mesh.vertices)


def test_a_checkpoint_of_another_architecture_is_refused(config: RunConfig, tmp_path: Path) -> None:
    model = Trainer(config).model
    deeper = model.network.model_copy(update={"blocks": 3})
    model.network = deeper  # a header that promises more than the file holds
    save_model(tmp_path / "model.safetensors", model)
    with pytest.raises(InputError, match="the weights are of another architecture") as error:
        load_model(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "no such file"), (b"not a model", "not a readable safetensors file")],
)
def test_a_file_that_is_no_model_is_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "model.safetensors").write_bytes(content)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path)


def test_a_model_of_another_version_is_refused(
    config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = Trainer(config).model
    monkeypatch.setattr("imgtransfer.training.checkpoint.FORMAT_VERSION", 99)
    save_model(tmp_path / "model.safetensors", model)
    monkeypatch.undo()
    with pytest.raises(
        InputError, match="imgtransfer-model version 1 or 2 wanted, found imgtransfer-model version 99"
    ):
        load_model(tmp_path)


def test_a_clip_without_a_garment_cannot_train(tube_clip: Clip) -> None:
    with pytest.raises(InputError, match="no garment_vertices"):
        Frames.from_clips(
            [replace(tube_clip, garment=None)],
            "root",
        )


def test_the_mirror_shows_the_mirrored_scene(config: RunConfig) -> None:
    """Flipped images equal images of the mirrored bodies, up to the pixel grid; the tubes are symmetric at rest."""
    trainer = Trainer(config)
    model, mirror = trainer.model, trainer.mirror
    assert mirror is not None
    body, truth = trainer.batch(trainer.train_frames, torch.arange(3))
    flipped = mirror.garment(truth)
    vertices = trainer.train_frames.read(torch.arange(3))[0] * torch.tensor([-1.0, 1.0, 1.0])
    partner = mirror_partners(model)
    positions, _ = metric_maps(model.imager, vertices[:, partner])
    both = model.mask & mirror.mask
    metres = model.box.decode(flipped.positions)
    # 2 mm: the mesh's diagonals are not mirrored, so both interpolate differently inside a face
    assert (metres - positions)[:, both].norm(dim=-1).mean() < 2e-3
    twice = mirror.garment(flipped)
    assert torch.equal(mirror.mask.flip(-1), model.mask)
    torch.testing.assert_close(twice.positions[:, both], truth.positions[:, both], rtol=0, atol=1e-5)
    guess = mirror.body(body).guess
    assert guess is not None
    assert body.guess is not None
    # a turned residual, mirrored, is the mirrored residual, turned
    sign, residual = torch.tensor([-1.0, 1.0, 1.0]), truth.normals
    torch.testing.assert_close(
        guess.turn((residual * sign).flip(-2)), (body.guess.turn(residual) * sign).flip(-2), rtol=0, atol=1e-6
    )


def mirror_partners(model: TransferModel) -> torch.Tensor:
    """(N,) the vertex at the mirror image of each template vertex."""
    template = torch.from_numpy(model.imager.mesh.vertices)
    return torch.cdist(template * torch.tensor([-1.0, 1.0, 1.0]), template).argmin(1)


def test_the_mirror_needs_front_and_back(source: Path) -> None:
    data = small_config(source).model_dump(mode="json")
    data["maps"]["views"] = ["front", "left"]
    with pytest.raises(InputError, match="azimuth 0 or 180 only, such as front and back; found left"):
        Trainer(parse_config(RunConfig, data, "run"))


def test_the_command_trains_resumes_and_says_where(
    config: RunConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    command = [
        "train",
        str(tmp_path / "run.yaml"),
        "--out",
        str(tmp_path / "out"),
        "--set",
        "training.steps=2",
    ]
    assert main(command) == 0
    assert str(tmp_path / "out" / "model.safetensors") in capsys.readouterr().out
    lines = [json.loads(line) for line in (tmp_path / "out" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [0, 1, 2]
    assert "position_mm" in lines[0]
    assert "position_mm" in lines[2]
    assert main(command) == 2
    assert main([*command, "--resume"]) == 0


def mirrored_losses(trainer: Trainer, index: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Both losses of frames that are all mirrored, their garment and silhouette too."""
    mirror, model = trainer.mirror, trainer.model
    assert mirror is not None
    body, truth = trainer.batch(trainer.train_frames, index)
    truth = mirror.garment(truth)
    found = model(
        mirror.body(body), garment=mirror.seen(trainer._outfit(trainer.train_frames, index).garment)
    )
    return (
        masked_l1(found.positions, truth.positions, mirror.mask),
        masked_l1(found.normals, truth.normals, mirror.mask),
    )


@pytest.mark.parametrize("coins", [[True, True, True], [True, False, True]])
def test_the_loss_of_a_mixed_batch_is_the_mean_of_its_frames(
    source: Path, coins: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    trainer = Trainer(small_config(source, batch_frames=3))
    trainer.train_step()  # residual networks start with 0
    model, frames = trainer.model, trainer.order.frames(1)
    losses = []
    with torch.no_grad():
        for frame, turned in zip(frames, coins, strict=True):
            body, truth = trainer.batch(trainer.train_frames, frame[None])
            found = model(body, garment=trainer._outfit(trainer.train_frames, frame[None]).garment)
            plain = (
                masked_l1(found.positions, truth.positions, model.mask),
                masked_l1(found.normals, truth.normals, model.mask),
            )
            losses.append(mirrored_losses(trainer, frame[None]) if turned else plain)
        whole = mirrored_losses(trainer, frames)
    monkeypatch.setattr(trainer.order, "coins", lambda step: torch.tensor(coins))
    found = trainer.train_step()
    for number, key in enumerate(("position_loss", "normal_loss")):
        assert found[key] == pytest.approx(sum(loss[number].item() for loss in losses) / 3, rel=1e-5)
        if all(coins):
            assert found[key] == pytest.approx(whole[number].item(), rel=1e-6)


def test_coins_are_fair_one_a_frame_and_the_steps_own() -> None:
    order = Order(8, 4, seed=3)
    coins = torch.stack([order.coins(step) for step in range(500)])
    assert 900 < coins.sum() < 1100  # 1000 ± 22
    assert (coins.any(1) & ~coins.all(1)).float().mean() > 0.8  # 7 / 8 of the batches are mixed
    assert torch.equal(Order(8, 4, seed=3).coins(7), coins[7])


def test_only_models_that_saw_mirrored_frames_average_with_them(source: Path, tmp_path: Path) -> None:
    for mirror in (True, False):
        model = Trainer(small_config(source, mirror=mirror)).model
        save_model(tmp_path / "model.safetensors", model)
        assert load_model(tmp_path).mirrored_average == mirror
