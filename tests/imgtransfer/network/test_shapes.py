"""One model over several body shapes: the same faces, another template and rest body a shape."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.cli.main import main
from imgtransfer.config.loader import parse_config
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from imgtransfer.evaluation.metrics import evaluate_clip
from imgtransfer.evaluation.skinning import lbs_baseline
from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.network.maps import metric_maps
from imgtransfer.network.shapes import misfit
from imgtransfer.training.checkpoint import load_model, save_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.sampler import Frames
from imgtransfer.training.trainer import Trainer
from render import InputError, Mesh, PositionBox, load_maps
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip as make_clip

NETWORK = {
    "encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2},
    "blocks": 1,
    "target": "residual",
    "frame": "body",
    "shortcuts": True,
}
FRAMES = ("canonical", "body")


@pytest.fixture(scope="module")
def clips() -> tuple[Clip, Clip, Clip]:
    """The tube in three shapes: as it is, stout and short, lean and tall."""
    return (
        make_clip(4, name="plain"),
        make_clip(3, name="stout", girth=1.3, tall=0.9),
        make_clip(5, name="lean", girth=0.85, tall=1.1),
    )


def body_of(clip: Clip) -> Mesh:
    return Mesh(clip.body.rest, clip.body.faces, clip.name)


def model_for(clip: Clip, *, frame: str = "body", body: bool = True) -> TransferModel:
    """An untrained model whose outputs are not 0."""
    torch.manual_seed(0)
    model = TransferModel(
        maps=MapsConfig(size=(64, 48)),
        network=NetworkConfig.model_validate(NETWORK | {"frame": frame}),
        template=clip.template_mesh,
        box=PositionBox.around(clip.template.vertices, margin=0.5),
        body=body_of(clip) if body else None,
    )
    for network in (model.position_net, model.normal_net):
        torch.nn.init.normal_(network.decoder.to_image.weight, std=0.1)
    return model.eval()


@pytest.mark.parametrize("frame", FRAMES)
def test_the_guess_for_a_rest_body_is_the_template_of_its_shape(clips: tuple[Clip, ...], frame: str) -> None:
    model = model_for(clips[0], frame=frame)
    rest = torch.from_numpy(np.stack([clip.body.rest for clip in clips]))
    templates = torch.from_numpy(np.stack([clip.template.vertices for clip in clips]))
    guess = model.body_imager(*clips)(rest, torch.arange(3)).guess
    assert guess is not None
    positions, normals = metric_maps(model.imager, templates)
    torch.testing.assert_close(guess.positions, positions, rtol=0, atol=1e-5)
    torch.testing.assert_close(guess.normals, normals, rtol=0, atol=1e-4)


def test_the_guess_of_another_shape_follows_a_rigid_motion(clips: tuple[Clip, ...]) -> None:
    model = model_for(clips[0])
    turn = Rotation.from_rotvec([0.5, -0.9, 0.7]).as_matrix().astype(np.float32)
    body = torch.from_numpy(clips[1].body.rest @ turn.T + np.float32(0.3))[None]
    guess = model.body_imager(*clips)(body, torch.tensor([1])).guess
    assert guess is not None
    moved = torch.from_numpy(clips[1].template.vertices @ turn.T + np.float32(0.3))[None]
    torch.testing.assert_close(guess.positions, metric_maps(model.imager, moved)[0], rtol=0, atol=1e-5)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_batch_of_mixed_shapes_equals_its_frames(clips: tuple[Clip, ...], frame: str) -> None:
    model = model_for(clips[0], frame=frame)
    imager = model.body_imager(*clips)
    order = [2, 0, 1, 0, 2]
    vertices = torch.from_numpy(np.stack([clips[k].body.vertices[j % 3] for j, k in enumerate(order)]))
    with torch.no_grad():
        together = model(imager(vertices, torch.tensor(order)))
        for index, shape in enumerate(order):
            alone = model(model.body_imager(clips[0], clips[shape])(vertices[index][None], torch.tensor([1])))
            own = model(model.body_imager(clips[shape])(vertices[index][None]))
            for single in (alone, own):
                torch.testing.assert_close(together.positions[index], single.positions[0], rtol=0, atol=1e-5)
                torch.testing.assert_close(together.normals[index], single.normals[0], rtol=0, atol=1e-4)


def zipped(clip: Clip) -> Clip:
    """The clip's template with its vertices in another order: another garment with the same faces."""
    return replace(
        clip,
        template=replace(
            clip.template, vertices=np.random.default_rng(0).permutation(clip.template.vertices)
        ),
    )


def laid_down(clip: Clip) -> Clip:
    """z up."""
    return replace(
        clip,
        template=replace(
            clip.template, vertices=clip.template.vertices[:, [0, 2, 1]] * np.float32([1, -1, 1])
        ),
        name="odd",
    )


def moved(clip: Clip, body: bool, *shift: float) -> Clip:
    """Template and perhaps rest body elsewhere."""
    changed = {"template_vertices": clip.template.vertices + np.float32(shift)}
    return with_arrays(clip, **changed | ({"body_rest": clip.body.rest + np.float32(shift)} if body else {}))


MISTAKES = {
    "centimetres": (
        lambda c: with_arrays(c, template_vertices=100 * c.template.vertices),
        "times as large as that of",
    ),
    "another up axis": (laid_down, "turned by 90 degrees against that of"),
    "another garment": (zipped, "its garment is (another|0.* times as large|turned)"),
    "rest pose metres away": (lambda c: moved(c, True, 2.0, 0.0, 0.0), "200 cm away, at rest, from that of"),
    "metres below": (lambda c: moved(c, True, 0.0, -1.0, 0.0), "cm away, at rest, from that of"),
    "beside its body": (lambda c: moved(c, False, 0.0, 0.09, 0.0), "9 cm off where it lies in"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_what_is_no_other_shape_is_refused_in_one_line(clips: tuple[Clip, ...], name: str) -> None:
    spoil, message = MISTAKES[name]
    odd = replace(spoil(clips[1]), name="odd")
    with pytest.raises(InputError, match=f"odd: its garment .* is not the model's.*{message}") as error:
        model_for(clips[0]).predict(odd)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match=rf"^odd: .*{message}.* plain; choose clips with data\.train\.names"):
        Frames.from_clips([clips[0], odd], "root")


def test_people_of_different_shapes_are_let_through(clips: tuple[Clip, ...]) -> None:
    template, body = clips[0].template_mesh, body_of(clips[0])
    assert [misfit(clip, template, body) for clip in clips] == [None] * 3


def test_other_faces_are_refused(clips: tuple[Clip, ...]) -> None:
    model, first = model_for(clips[0]), clips[0]
    cut = replace(
        clips[1], template=replace(clips[1].template, faces=clips[1].template.faces[:-1]), name="cut"
    )
    with pytest.raises(InputError, match=r"cut: its garment \(192 vertices, 351 faces\) is not the model's"):
        model.check_garment(cut)
    with pytest.raises(
        InputError, match=r"cut: its garment_faces differ from those of plain; .*train\.names"
    ):
        Frames.from_clips([first, cut], "root")
    other = replace(clips[1], body=replace(clips[1].body, faces=clips[1].body.faces[::-1]), name="other")
    with pytest.raises(InputError, match=r"other: its garment .* in its own shape, and its body is not the"):
        model.check_garment(other)
    with pytest.raises(InputError, match=r"other: its body_faces differ from those of plain; .*train\.names"):
        Frames.from_clips([first, other], "root")


def test_the_models_own_garment_may_be_worn_by_another_body_mesh(clips: tuple[Clip, ...]) -> None:
    """Imaged through its own rest body, as where the model knows no body."""
    clip = clips[0]
    faces = clip.body.faces[::-1]
    other = model_for(clip).predict(replace(clip, body=replace(clip.body, faces=faces)))
    unaware = model_for(clip, body=False).predict(replace(clip, body=replace(clip.body, faces=faces)))
    assert torch.equal(other.positions, unaware.positions)
    assert other.rest_vertices is None


def test_a_model_of_the_earlier_format_knows_one_shape(
    clips: tuple[Clip, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = model_for(clips[0], body=False)
    monkeypatch.setattr("imgtransfer.training.checkpoint.FORMAT_VERSION", 1)
    save_model(tmp_path / "model.safetensors", model)
    monkeypatch.undo()
    loaded = load_model(tmp_path)
    assert loaded.body is None
    assert torch.equal(loaded.predict(clips[0]).positions, model.predict(clips[0]).positions)
    with pytest.raises(InputError, match=r"stout: its garment .* in its one shape; a model trained anew"):
        loaded.predict(clips[1])


def test_a_stored_model_knows_its_body(clips: tuple[Clip, ...], tmp_path: Path) -> None:
    model = model_for(clips[0])
    save_model(tmp_path / "model.safetensors", model)
    loaded = load_model(tmp_path)
    for clip in clips:
        assert torch.equal(loaded.predict(clip).positions, model.predict(clip).positions)


def test_predict_and_fuse_keep_the_clips_own_template(clips: tuple[Clip, ...], tmp_path: Path) -> None:
    save_model(tmp_path / "model.safetensors", model_for(clips[0]))
    for clip in clips[:2]:
        save_clip(tmp_path / "clips" / f"{clip.name}.npz", clip)
    out = tmp_path / "out"
    assert main(["predict", str(tmp_path), str(tmp_path / "clips"), "--out", str(out)]) == 0
    assert load_maps(out / "plain" / "maps.npz").rest_vertices is None
    np.testing.assert_array_equal(
        load_maps(out / "stout" / "maps.npz").rest.vertices, clips[1].template.vertices
    )
    assert main(["fuse", str(out)]) == 0
    for clip in clips[:2]:
        for name in ("position_only.npz", "fused.npz"):
            written = load_clip(out / clip.name / name)
            np.testing.assert_array_equal(written.template.vertices, clip.template.vertices)
        lengths = [
            np.linalg.norm(np.diff(vertices[..., clip.template_mesh.edges, :], axis=-2), axis=-1).mean()
            for vertices in (
                load_clip(out / clip.name / "fused.npz").garment.vertices,
                clip.template.vertices,
            )
        ]
        assert lengths[0] == pytest.approx(lengths[1], rel=0.02)  # stout edges are 22 % longer on average


def test_frames_know_their_shape(clips: tuple[Clip, ...]) -> None:
    frames = Frames.from_clips([*clips, replace(clips[1], name="again")], "root")
    assert [clip.name for clip in frames.shapes] == ["plain", "stout", "lean"]
    garment, body, shape = frames.read(torch.arange(len(frames)))
    assert shape.tolist() == [0] * 4 + [1] * 3 + [2] * 5 + [1] * 3
    assert torch.equal(garment[4:7], garment[12:])
    assert garment.shape[1:] == clips[0].template.vertices.shape
    assert body.shape[1:] == clips[0].body.rest.shape


def test_shapes_are_known_over_chunks(tmp_path: Path) -> None:
    data = DataSet.create(tmp_path / "data.zarr")
    for name, frames, girth in (("tube/a", 70, 1.0), ("tube/b", 40, 1.2), ("tube/c", 3, 1.0)):
        data.write(name, make_clip(frames, girth=girth), split="train")
    frames = Frames([ref.reader() for ref in clip_refs(tmp_path / "data.zarr")], "root")
    assert frames.n_chunks > 3
    _, _, shape = frames.read(torch.arange(len(frames)))
    assert shape.tolist() == [0] * 70 + [1] * 40 + [0] * 3


def mixed_run(folder: Path, clips: tuple[Clip, ...], **training: object) -> RunConfig:
    """Trained on plain and stout, validated on all of `clips`."""
    for clip in clips:
        save_clip(folder / f"{clip.name}.npz", clip)
    return parse_config(
        RunConfig,
        {
            "data": {
                "source": str(folder),
                "train": {"split": None, "exclude": ["lean"]},
                "validation": {"split": None},
            },
            "maps": {"size": [32, 32]},
            "network": NETWORK,
            "training": {"batch_frames": 3, "threads": 1, "optimizer": "adamw"} | training,
        },
        "mixed",
    )


def test_training_on_mixed_shapes_beats_their_guess(clips: tuple[Clip, ...], tmp_path: Path) -> None:
    trainer = Trainer(mixed_run(tmp_path, clips[:2], steps=60, learning_rate=2e-3, schedule="cosine"))
    assert [len(frames.shapes) for frames in (trainer.train_frames, trainer.validation_frames)] == [2, 2]
    for _ in range(60):
        trainer.train_step()
    errors = trainer.validate()
    assert errors["position_mm"] < 0.9 * errors["guess_position_mm"]
    assert errors["normal_degrees"] < errors["guess_normal_degrees"]


def test_the_mirror_shows_the_mirrored_scene_of_every_shape(clips: tuple[Clip, ...], tmp_path: Path) -> None:
    trainer = Trainer(mixed_run(tmp_path, clips, mirror=True))
    model, mirror, frames = trainer.model, trainer.mirror, trainer.validation_frames
    assert mirror is not None
    index = torch.arange(len(frames))
    body, truth = trainer.batch(frames, index)
    sign = torch.tensor([-1.0, 1.0, 1.0])
    flipped = mirror.garment(truth)
    template = torch.from_numpy(model.imager.mesh.vertices)
    partner = torch.cdist(template * sign, template).argmin(1)
    positions, _ = metric_maps(model.imager, (frames.read(index)[0] * sign)[:, partner])
    both = model.mask & mirror.mask
    off = (model.box.decode(flipped.positions) - positions)[:, both].norm(dim=-1).mean(1)
    assert off.max() < 2.5e-3  # as for one shape; the stout one's faces are larger by a third
    guess = mirror.body(body).guess
    assert guess is not None
    assert body.guess is not None
    before = (body.guess.positions - model.box.decode(truth.positions))[:, model.mask].norm(dim=-1)
    after = (guess.positions - model.box.decode(flipped.positions))[:, mirror.mask].norm(dim=-1)
    torch.testing.assert_close(after.mean(1), before.mean(1), rtol=1e-3, atol=1e-6)


def test_the_skinned_baseline_takes_each_clips_own_shape(clips: tuple[Clip, ...]) -> None:
    for clip in clips:
        assert clip.garment is not None
        skinned = lbs_baseline(clip)
        found = evaluate_clip(
            skinned, clip.garment.vertices, clip.template.faces, clip.body.vertices, clip.body.faces
        )
        assert found["rmse_mm"] < 12  # the ripple is 4 mm on average, 8 at most


def test_inspect_counts_shapes(
    clips: tuple[Clip, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for clip in clips:
        save_clip(tmp_path / f"{clip.name}.npz", clip)
    assert main(["inspect", str(tmp_path), "--views", "front"]) == 0
    printed = capsys.readouterr().out
    assert "the garment of lean comes in 3 shapes" in printed
    assert printed.count("vertices seen of") == 1
