"""Methods through the commands: trained, gone on with, predicted, fused, measured, and refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip, save_clip
from imgtransfer.deformers import load_deformer
from imgtransfer.deformers.image_transfer import ImageTransfer
from imgtransfer.training import fingerprint
from render import load_maps
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.helpers.training import SMALL

LBS = "data: {source: clips, train: {names: [one]}}\nmethod: {name: lbs, diffusion: 0.05}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two clips and a fit's configuration, in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name, frames in (("one", 6), ("two", 3)):
        save_clip(f"clips/{name}.npz", tube_clip(frames))
    Path("lbs.yaml").write_text(LBS)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    capsys.readouterr()
    assert main(list(argv)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "Traceback" not in error
    return error


def test_a_method_is_trained_predicts_and_is_measured(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    assert "next    imgtransfer predict run clips" in capsys.readouterr().out
    assert main(["predict", "run", "clips", "--clip", "two", "--out", "p"]) == 0
    assert "next     imgtransfer evaluate p --truth clips --clip two" in capsys.readouterr().out
    made = load_clip("p/two/position_only.npz")
    np.testing.assert_array_equal(
        made.garment.vertices, load_deformer("run").predict(load_clip("clips/two.npz"))
    )
    assert made.info["model"] == fingerprint("run")
    assert not Path("p/two/maps.npz").exists()
    assert main(["evaluate", "p", "--truth", "clips", "--json"]) == 0
    assert 3 < json.loads(capsys.readouterr().out)["overall"]["rmse_mm"] < 12  # the ripple is up to 8 mm
    assert main(["predict", "run", "clips", "--clip", "two", "--out", "p"]) == 0
    assert "predicted by this model already" in capsys.readouterr().out


def test_with_the_fusion_both_results_stay(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    assert main(["predict", "run", "clips/two.npz", "--out", "p", "--fuse"]) == 0
    skinned, fused = (load_clip(f"p/two/{name}.npz").garment.vertices for name in ("position_only", "fused"))
    assert 0 < np.linalg.norm(skinned - fused, axis=-1).mean() < 0.01
    for method in ("position_only", "fused"):
        assert main(["evaluate", "p", "--truth", "clips", "--method", method]) == 0
    capsys.readouterr()
    assert main(["predict", "run", "clips/two.npz", "--out", "p", "--fuse"]) == 0
    assert "predicted by this model already" in capsys.readouterr().out


@pytest.mark.parametrize("girth", [0.3, 1.0])
def test_the_fusion_keeps_the_cloth_where_that_of_the_clips_rests(folder: Path, girth: float) -> None:
    """12 mm off the skin, which a method is fitted to; or 40 mm, which says nothing."""
    save_clip("clips/one.npz", tube_clip(6, girth=girth))
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    assert main(["predict", "run", "clips/one.npz", "--out", "p", "--fuse"]) == 0
    known = load_deformer("run").contact_offset_m
    assert known == (pytest.approx(0.012, abs=0.001) if girth < 1 else None)
    assert load_maps("p/one/maps.npz").contact_offset_m == known
    assert json.loads(Path("p/one/fusion.json").read_text())["collision_margin_m"] == (known or 0)


def test_a_run_goes_on_only_as_it_was(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no run to resume" in refused(capsys, "train", "lbs.yaml", "--out", "run", "--resume")
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    before = fingerprint("run")
    assert "holds a run already" in refused(capsys, "train", "lbs.yaml", "--out", "run")
    assert main(["train", "lbs.yaml", "--out", "run", "--resume", "--set", "threads=1"]) == 0
    assert fingerprint("run") == before
    assert "method.diffusion is 0.0 now and was 0.05" in refused(
        capsys, "train", "lbs.yaml", "--out", "run", "--resume", "--set", "method.diffusion=0"
    )
    Path("run/config.yaml").unlink()
    assert "config.yaml is missing" in refused(capsys, "train", "lbs.yaml", "--out", "run", "--resume")


def test_a_fit_that_failed_begins_anew(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_clip("clips/one.npz", with_arrays(tube_clip(6), blend_weights=None))
    assert "lacks blend_weights" in refused(capsys, "train", "lbs.yaml", "--out", "run")
    save_clip("clips/one.npz", tube_clip(6))
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["method.name=knit"], "no method 'knit'; there are image_transfer, lbs"),
        (["method.neighbors=3"], "did you mean neighbours"),
        (["method=3"], "a section with the name of a method"),
        (["training.steps=3"], "training: no such setting"),
        (["data.train.names=[none]"], "no clip matches"),
        (["data.validation.names=[two]"], "no such setting"),
    ],
)
def test_configurations_that_nobody_means(
    folder: Path, capsys: pytest.CaptureFixture[str], changes: list[str], message: str
) -> None:
    given = [word for change in changes for word in ("--set", change)]
    assert message in refused(capsys, "train", "lbs.yaml", "--out", "run", *given)
    assert not Path("run/model.safetensors").exists()


def test_a_method_s_file_that_is_damaged_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    path = Path("run/model.safetensors")
    good, tensors = path.read_bytes(), load_file(path)
    header = '{"format": "imgtransfer-deformer", "format_version": 2, "method": %s, "config": %s}'
    for method, config, lacking in (
        ('"knit"', "{}", None),
        ("3", "{}", None),
        ('"lbs"', '{"neighbours": 0}', None),
        ('"lbs"', "[]", None),
        ('"lbs"', "{}", "weights"),
    ):
        kept = {key: value for key, value in tensors.items() if key != lacking}
        save_file(kept, path, metadata={"imgtransfer": header % (method, config)})
        assert str(path) in refused(capsys, "predict", "run", "clips", "--out", "p")
    tensors["weights"][0] = np.nan
    save_file(tensors, path, metadata={"imgtransfer": header % ('"lbs"', "{}")})
    assert "not finite" in refused(capsys, "predict", "run", "clips", "--out", "p")
    path.write_bytes(good[: len(good) // 2])
    assert "not a readable safetensors file" in refused(capsys, "predict", "run", "clips", "--out", "p")


def test_a_network_s_option_is_refused_for_a_method(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "lbs.yaml", "--out", "run"]) == 0
    assert "averages nothing" in refused(
        capsys, "predict", "run", "clips", "--out", "p", "--no-mirrored-average"
    )


def test_the_network_is_a_method_too(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    training = {key: value for key, value in SMALL["training"].items() if key != "threads"} | {"steps": 1}
    config = {
        "data": {"source": "clips", "train": {"names": ["one"]}, "validation": {"names": ["two"]}},
        "method": {"name": "image_transfer", **SMALL, "training": training},
        "threads": 1,
    }
    Path("network.yaml").write_text(json.dumps(config))
    assert main(["train", "network.yaml", "--out", "run"]) == 0
    method = load_deformer("run")
    assert isinstance(method, ImageTransfer)
    clip = load_clip("clips/two.npz")
    again = ImageTransfer(method.config)
    again.restore(method.tensors())
    np.testing.assert_array_equal(again.predict(clip), method.predict(clip))
    assert method.parameters() == again.parameters() > 0
    assert "training.seed: of a method it stands at the top" in refused(
        capsys, "train", "network.yaml", "--out", "other", "--set", "method.training.seed=3"
    )
