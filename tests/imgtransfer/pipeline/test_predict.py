"""Prediction: a trained model on clips, and the files that `imgtransfer predict` writes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.cli.main import main
from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.reader import NpzReader
from imgtransfer.data.store import DataSet
from imgtransfer.network import TransferModel
from imgtransfer.network.history import vertical
from imgtransfer.network.mirror import Mirror
from imgtransfer.network.model import Predictor
from imgtransfer.network.prediction import Prediction, ShownFrames
from imgtransfer.pipeline.folder import MAPS_FILE, POSITION_ONLY_FILE, predicted_clips
from imgtransfer.pipeline.predict import save_prediction
from imgtransfer.training.checkpoint import save_model
from render import InputError, load_maps
from tests.helpers.models import local_model_for, model_for


def test_prediction_has_maps_of_every_frame(tube_clip: Clip) -> None:
    model = model_for(tube_clip)
    prediction = model.predict(tube_clip)
    assert prediction.positions.shape == prediction.normals.shape == (6, 2, 64, 48, 3)
    mask = prediction.imager.mask
    assert prediction.positions[:, ~mask].abs().max() == 0
    assert prediction.normals[:, ~mask].abs().max() == 0
    lengths = (prediction.normals[:, mask] * 2 - 1).norm(dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths), rtol=0, atol=1e-5)
    assert prediction.metres()[:, ~mask].abs().max() == 0


def test_prediction_does_not_look_at_the_garment(tube_clip: Clip) -> None:
    model = model_for(tube_clip)
    without = model.predict(replace(tube_clip, garment=None))
    assert torch.equal(without.positions, model.predict(tube_clip).positions)


def test_where_a_body_stands_and_faces_changes_nothing_in_the_maps(tube_clip: Clip) -> None:
    """A turn about the vertical and a shift of the clip are removed with the root, and come back in the frames."""
    model = model_for(tube_clip)
    assert tube_clip.skeleton.poses is not None
    assert tube_clip.skeleton.trans is not None
    assert tube_clip.skeleton.joints_rest is not None
    turn, shift = Rotation.from_rotvec([0.0, 1.1, 0.0]), np.array([3.0, 0.5, -2.0])
    root = tube_clip.skeleton.joints_rest[0]
    poses = tube_clip.skeleton.poses.copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    moved = replace(
        tube_clip,
        skeleton=replace(
            tube_clip.skeleton,
            poses=poses,
            trans=(turn.apply(tube_clip.skeleton.trans + root) + shift - root).astype(np.float32),
        ),
        body=replace(
            tube_clip.body, vertices=(tube_clip.body.vertices @ turn.as_matrix().T + shift).astype(np.float32)
        ),
    )
    before, after = model.predict(tube_clip), model.predict(moved)
    torch.testing.assert_close(after.positions, before.positions, rtol=0, atol=1e-4)
    there = after.frames.to_world(np.zeros((6, 1, 3)))
    back = before.frames.to_world(np.zeros((6, 1, 3))) @ turn.as_matrix().T + shift
    np.testing.assert_allclose(there, back, atol=1e-5)


def test_a_clip_with_another_garment_is_refused(tube_clip: Clip) -> None:
    model = model_for(tube_clip)
    other = replace(
        tube_clip,
        template=replace(tube_clip.template, vertices=tube_clip.template.vertices + np.float32(0.01)),
        name="shifted",
    )
    with pytest.raises(InputError, match=r"shifted: its garment .* is not the model's"):
        model.predict(other)


def test_the_command_writes_maps_and_vertices(
    tube_clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = model_for(tube_clip)
    save_model(tmp_path / "model.safetensors", model)
    data = DataSet.create(tmp_path / "data.zarr")
    data.write("tube/bend", tube_clip, split="test")
    data.write("tube/other", tube_clip, split="train")
    command = [
        "predict",
        str(tmp_path),
        str(tmp_path / "data.zarr"),
        "--split",
        "test",
        "--out",
        str(tmp_path / "o"),
    ]
    assert main(command) == 0
    out = tmp_path / "o"
    assert capsys.readouterr().out.splitlines() == [
        f"{out / 'tube__bend'}  6 frames",
        f"next     imgtransfer fuse {out}",
        f"then     imgtransfer evaluate {out} --truth {tmp_path / 'data.zarr'} --split test",
    ]
    assert [folder.name for folder in (tmp_path / "o").iterdir()] == ["tube__bend"]
    maps, prediction = load_maps(tmp_path / "o" / "tube__bend" / "maps.npz"), model.predict(tube_clip)
    assert maps.position is not None
    np.testing.assert_array_equal(maps.position, prediction.positions.numpy())
    np.testing.assert_array_equal(maps.rotation, prediction.frames.rotation)
    vertices = load_clip(tmp_path / "o" / "tube__bend" / "position_only.npz").garment.vertices
    assert vertices is not None
    assert tube_clip.garment is not None
    # in the world frame, beside the true garment: an untrained model adds centimetres to the first guess
    assert np.linalg.norm(vertices - tube_clip.garment.vertices, axis=-1).mean() < 0.1


def test_the_command_predicts_for_a_body_alone(tube_clip: Clip, tmp_path: Path) -> None:
    save_model(tmp_path / "model.safetensors", model_for(tube_clip))
    save_clip(
        tmp_path / "walk.npz",
        replace(tube_clip, garment=None),
    )
    assert main(["predict", str(tmp_path), str(tmp_path / "walk.npz"), "--out", str(tmp_path / "o")]) == 0
    assert load_clip(tmp_path / "o" / "walk" / "position_only.npz").garment is not None


def test_the_command_leaves_what_the_same_model_predicted(
    tube_clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, maps = model_for(tube_clip), tmp_path / "o" / "walk" / "maps.npz"
    save_model(tmp_path / "model.safetensors", model)
    save_clip(tmp_path / "walk.npz", tube_clip)
    command = ["predict", str(tmp_path), str(tmp_path / "walk.npz"), "--out", str(tmp_path / "o")]

    def writes_anew(*more: str) -> bool:
        before = maps.stat().st_ino if maps.exists() else None
        assert main([*command, *more]) == 0
        assert ("predicted by this model already" in capsys.readouterr().out) == (
            maps.stat().st_ino == before
        )
        return maps.stat().st_ino != before

    assert writes_anew()
    assert not writes_anew()
    assert writes_anew("--overwrite")
    (tmp_path / "o" / "walk" / "fused.npz").write_bytes(b"of the earlier prediction")
    save_clip(
        tmp_path / "walk.npz",
        replace(
            tube_clip, body=replace(tube_clip.body, vertices=tube_clip.body.vertices + np.float32(0.001))
        ),
    )
    assert writes_anew()
    assert not (tmp_path / "o" / "walk" / "fused.npz").exists()
    save_model(tmp_path / "model.safetensors", model, steps=1)
    assert writes_anew()
    assert not writes_anew()
    vertices = maps.with_name("position_only.npz")
    stored = load_clip(vertices)
    del stored.info["made"]
    save_clip(vertices, stored)  # as versions wrote it that kept no fingerprint
    assert writes_anew()
    vertices.write_bytes(vertices.read_bytes()[:-5000])
    assert writes_anew()
    assert not writes_anew()
    (tmp_path / "o" / "walk" / "notes.txt").write_text("precious")
    assert main([*command, "--overwrite"]) == 2
    assert "holds other files" in capsys.readouterr().err


def test_sigterm_leaves_nothing_half_written_and_a_lost_prediction_is_put_back(
    tube_clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save_model(tmp_path / "model.safetensors", model_for(tube_clip))
    save_clip(tmp_path / "walk.npz", tube_clip)
    out = tmp_path / "out"
    command = [
        "predict",
        *(str(tmp_path / name) for name in ("model.safetensors", "walk.npz")),
        "--out",
        str(out),
    ]

    def killed(*_: object) -> None:
        assert len(list(out.glob(".walk-*"))) == 1
        os.kill(os.getpid(), signal.SIGTERM)

    with monkeypatch.context() as patched:
        patched.setattr("render.files.atomic.put_in_place", killed)
        assert main(command) == 143
    assert capsys.readouterr().err.splitlines()[-1] == "imgtransfer: stopped"
    assert list(out.iterdir()) == []
    assert main(command) == 0
    (out / "walk").rename(out / ".walk-abcdefgh.old")  # as a kill between two renamings leaves it
    assert predicted_clips(out) == [out / "walk"]
    (out / "walk").rename(out / ".walk-abcdefgh.old")
    assert main(command) == 0
    assert [path.name for path in out.iterdir()] == ["walk"]


def test_the_command_refuses_another_garment_before_it_writes(tube_clip: Clip, tmp_path: Path) -> None:
    save_model(tmp_path / "model.safetensors", model_for(tube_clip))
    save_clip(tmp_path / "clips" / "a.npz", tube_clip)
    wide = replace(
        tube_clip,
        template=replace(tube_clip.template, vertices=tube_clip.template.vertices * np.float32(1.1)),
    )
    save_clip(tmp_path / "clips" / "b.npz", wide)
    assert main(["predict", str(tmp_path), str(tmp_path / "clips"), "--out", str(tmp_path / "o")]) == 2
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("make", [model_for, local_model_for])
def test_a_prediction_on_disk_does_not_depend_on_the_number_of_threads(
    tube_clip: Clip,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    make: Callable[[Clip], TransferModel],
) -> None:
    """To the byte, in batches of which several are under way at once, also where each goes on from the one before."""
    monkeypatch.setattr("imgtransfer.pipeline.predict.FRAMES_AT_ONCE", 1)
    save_clip(tmp_path / "tube.npz", tube_clip)
    model, before = make(tube_clip), torch.get_num_threads()
    for threads in (1, 2, 5):
        torch.set_num_threads(threads)
        try:
            save_prediction(tmp_path / str(threads), model, NpzReader(tmp_path / "tube.npz"), record={})
            assert torch.get_num_threads() == threads
        finally:
            torch.set_num_threads(before)
    for name in (MAPS_FILE, POSITION_ONLY_FILE):
        one, two, five = ((tmp_path / threads / name).read_bytes() for threads in ("1", "2", "5"))
        assert one == two == five


@pytest.mark.parametrize("threads", [1, 2])
def test_a_clip_whose_last_batch_fails_leaves_nothing(
    tube_clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: int
) -> None:
    monkeypatch.setattr("imgtransfer.pipeline.predict.FRAMES_AT_ONCE", 2)
    monkeypatch.setattr("imgtransfer.pipeline.predict.n_threads", lambda: threads)
    predicted, calls = Predictor.predicted, count()

    def third_fails(self: Predictor, shown: ShownFrames) -> Prediction:
        if next(calls) == 2:
            raise InputError("the last batch")
        return predicted(self, shown)

    monkeypatch.setattr(Predictor, "predicted", third_fails)
    save_clip(tmp_path / "tube.npz", tube_clip)
    with pytest.raises(InputError, match="the last batch"):
        save_prediction(tmp_path / "out", model_for(tube_clip), NpzReader(tmp_path / "tube.npz"), record={})
    assert [path.name for path in tmp_path.iterdir()] == ["tube.npz"]


def test_a_model_that_predicts_no_numbers_is_named(tube_clip: Clip) -> None:
    model = model_for(tube_clip)
    torch.nn.init.constant_(model.position_net.decoder.to_image.weight, 1e38)
    model.source = "shirt.safetensors"
    with pytest.raises(InputError, match=r"shirt\.safetensors: predicts values that are not finite"):
        model.predict(tube_clip)


@pytest.mark.parametrize("make", [model_for, local_model_for])
def test_the_mirrored_average_is_of_two_predictions(
    tube_clip: Clip, make: Callable[[Clip], TransferModel]
) -> None:
    """Of metres, pixel by pixel; the other one is that of the mirrored body, mirrored back."""
    model, clip = make(tube_clip), tube_clip.slice(slice(0, 1))
    imager = model.body_imager(clip)
    mirror = Mirror(model.imager, model.mask, imager.mask, model.box)
    earlier = None
    vertices = torch.from_numpy(root_frames(clip, "root").to_canonical(clip.body.vertices))
    if imager.view is not None:
        earlier = imager.view.samples(vertices)[
            :, None
        ]  # before the clip the body stood as in its first frame
    up = torch.from_numpy(vertical(root_frames(clip, "root")))
    body, garment = imager(vertices, earlier=earlier, up=up), model.seen(imager)
    with torch.no_grad():
        other = model(mirror.body(body), garment=mirror.seen(garment)).positions
    back = torch.tensor([-1.0, 1, 1]) * model.box.decode(other).flip(-2)  # the tube stands about x = 0
    plain = model.predict(clip).metres()
    model.mirrored_average = True
    averaged = model.predict(clip).metres()
    torch.testing.assert_close(averaged, (plain + back) / 2 * model.mask[..., None], rtol=0, atol=1e-5)
    assert (averaged - plain).abs().max() > 1e-3


def test_the_command_averages_with_the_mirrored_prediction_unless_told_not_to(
    tube_clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = model_for(tube_clip)
    clip = tube_clip.slice(slice(1, 3))
    plain = model.predict(clip).positions
    model.mirrored_average = True
    averaged = model.predict(clip).positions
    save_clip(tmp_path / "bend.npz", clip)
    save_model(tmp_path / "model.safetensors", model)
    command = ["predict", str(tmp_path), str(tmp_path / "bend.npz"), "--out", str(tmp_path / "out")]
    for more, want in ((), averaged), (("--no-mirrored-average",), plain):
        assert main([*command, *more]) == 0  # another prediction takes the place of the first
        found = load_maps(tmp_path / "out" / "bend" / "maps.npz").position
        np.testing.assert_array_equal(found, want.numpy())
    assert (averaged - plain).abs().max() > 1e-3
    model.mirrored_average = False
    save_model(tmp_path / "model.safetensors", model)
    assert main([*command, "--no-mirrored-average"]) == 2
    assert "does not average with mirrored predictions" in capsys.readouterr().err
