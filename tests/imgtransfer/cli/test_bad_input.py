"""What users get wrong, through every command: one line, exit status 2, nothing half-written.

Mistakes that belong to one command alone are tested beside that command.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from imgtransfer.cli.main import main
from imgtransfer.config.loader import parse_config, to_yaml
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.store import DataSet
from imgtransfer.training.checkpoint import save_model
from imgtransfer.training.config import RunConfig
from tests.helpers.full_disk import full_disk
from tests.helpers.models import model_for
from tests.helpers.training import SMALL

SIMULATION = "clips: [{motion: walk, seconds: 0.2}]\n"


@pytest.fixture(scope="module")
def good(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good input of every kind: clip.npz, set, model.safetensors, predictions/clip, run.yaml, simulation.yaml."""
    folder = tmp_path_factory.mktemp("good")
    save_clip(folder / "clip.npz", tube_clip)
    data = DataSet.create(folder / "set")
    for split in ("train", "validation"):
        data.write(f"tube/{split}", tube_clip, split=split)
    save_model(folder / "model.safetensors", model_for(tube_clip))
    assert (
        main(
            [
                "predict",
                str(folder / "model.safetensors"),
                str(folder / "clip.npz"),
                "--out",
                str(folder / "p"),
            ]
        )
        == 0
    )
    source = {"source": str(folder / "set"), "validation": {"split": "validation"}}
    (folder / "run.yaml").write_text(to_yaml(parse_config(RunConfig, SMALL | {"data": source}, "run")))
    (folder / "simulation.yaml").write_text(SIMULATION)
    return folder


@pytest.fixture
def here(good: Path, tmp_path: Path) -> Path:
    """A copy of the good input, to spoil."""
    return Path(shutil.copytree(good, tmp_path / "in"))


def refused(capsys: pytest.CaptureFixture[str], *argv: object, message: str, out: Path | None = None) -> None:
    """Run a command that must fail cleanly; `out` must be absent or empty afterwards, hidden files included."""
    capsys.readouterr()
    assert main([str(word) for word in argv]) == 2
    error = capsys.readouterr().err
    assert error.startswith("imgtransfer: error: ")
    assert error.count("\n") == 1
    assert message in error
    if out is not None:
        assert not out.exists() or not list(out.iterdir())
        assert not list(out.parent.glob(f".{out.name}*"))


def change(path: Path, **arrays: object) -> Path:
    """Replace arrays of an npz; None removes one."""
    with np.load(path) as stored:
        kept = {**stored, **arrays}
    np.savez(path, **{name: value for name, value in kept.items() if value is not None})
    return path


def cut_short(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


# clips, through each command that reads them

READERS: dict[str, Callable[[Path, Path], tuple[list[object], Path | None]]] = {
    "predict": lambda h, o: (["predict", h / "model.safetensors", h / "clip.npz", "--out", o], o),
    "train": lambda h, o: (
        ["train", h / "run.yaml", "--data", h / "clip.npz", "--set", "data.train.split=null",
         "--set", "data.validation.split=null", "--out", o], o,
    ),
    "evaluate": lambda h, _: (["evaluate", h / "p", "--truth", h / "clip.npz"], None),
    "baseline": lambda h, _: (["evaluate", "--baseline", "lbs", "--truth", h / "clip.npz"], None),
    "render": lambda h, o: (["render", h / "clip.npz", "--size", "32", "--out", o], o),
    "inspect": lambda h, _: (["inspect", h / "clip.npz"], None),
    "export": lambda h, o: (["export", h / "clip.npz", "--clip", "clip", "--out", o], o),
    "import": lambda h, o: (["import", h / "clip.npz", "--split", "train", "--to", o], o),
    "fuse": lambda h, o: (
        ["fuse", "--maps", h / "p/clip/maps.npz", "--body", h / "clip.npz", "--out", o], o,
    ),
}  # fmt: skip
CLIPS = {
    "a face index out of range": (
        {"body_faces": np.array([[0, 1, 999]])},
        "face 0 uses vertices [0, 1, 999]",
    ),
    "a negative face index": ({"garment_faces": np.array([[0, 1, -1]])}, "only 0..191 exist"),
    "no faces": ({"garment_faces": np.zeros((0, 3), np.int64)}, "no faces"),
    "vertices not finite": ({"body_vertices": np.full((6, 128, 3), np.inf, np.float32)}, "not finite"),
    "joints not finite": ({"joints_rest": np.full((2, 3), np.nan, np.float32)}, "joints_rest: vertex 0"),
    "words for numbers": ({"template_vertices": np.full((192, 3), "x")}, "numbers are wanted"),
    "pickled objects": ({"poses": np.array([{}], object)}, "poses is not a readable plain array"),
    "frames that do not fit": ({"poses": np.zeros((2, 2, 3), np.float32)}, "poses must have shape"),
    "no frame rate": ({"fps": np.float64(0)}, "fps is 0.0"),
    "a parent that is none": ({"parents": np.array([-1, -7])}, "parents must be indices"),
}


@pytest.mark.parametrize("fault", CLIPS)
@pytest.mark.parametrize("command", READERS)
def test_clips(here: Path, capsys: pytest.CaptureFixture[str], command: str, fault: str) -> None:
    arrays, message = CLIPS[fault]
    change(here / "clip.npz", **arrays)
    argv, out = READERS[command](here, here / "out")
    refused(capsys, *argv, message=message, out=out)


@pytest.mark.parametrize("command", READERS)
def test_clip_files_that_are_missing_or_cut_short(
    here: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    argv, out = READERS[command](here, here / "out")
    cut_short(here / "clip.npz")
    refused(capsys, *argv, message="clip.npz: not a readable npz", out=out)
    (here / "clip.npz").unlink()
    refused(capsys, *argv, message="clip.npz: no such file", out=out)


# data sets

SETS: dict[str, tuple[Callable[[Path], object], str]] = {
    "another schema version": (lambda s: set_attributes(s, schema_version=9), "schema version 9"),
    "a store of something else": (lambda s: set_attributes(s, format="weather"), "its format is 'weather'"),
    "metadata cut short": (lambda s: cut_short(s / "zarr.json"), "not the metadata of a Zarr v3 group"),
    "an array missing": (
        lambda s: shutil.rmtree(s / "tube/train/body_faces"),
        "body_faces/zarr.json: no such file; the store is damaged",
    ),
    "a chunk cut short": (lambda s: cut_short(s / "tube/train/body_rest/c/0/0"), "the store is damaged"),
}


def set_attributes(path: Path, **changed: object) -> None:
    stored = json.loads((path / "zarr.json").read_text())
    stored["attributes"] |= changed
    (path / "zarr.json").write_text(json.dumps(stored))


@pytest.mark.parametrize("fault", SETS)
@pytest.mark.parametrize("command", ["predict", "train", "evaluate", "render", "inspect", "export"])
def test_data_sets(here: Path, capsys: pytest.CaptureFixture[str], command: str, fault: str) -> None:
    spoil, message = SETS[fault]
    spoil(here / "set")
    out, data = here / "out", here / "set"
    argv = {
        "predict": ["predict", here / "model.safetensors", data, "--clip", "tube/train", "--out", out],
        "train": ["train", here / "run.yaml", "--data", data, "--out", out],
        "evaluate": [
            "evaluate",
            "--baseline",
            "lbs",
            "--truth",
            data,
        ],  # a prediction reads only its own clips
        "render": ["render", data, "--size", "32", "--out", out],
        "inspect": ["inspect", data],
        "export": ["export", data, "--clip", "tube/train", "--out", out],
    }[command]
    refused(capsys, *argv, message=message, out=out)


def test_predict_goes_on_with_the_other_clips_of_a_damaged_set(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut_short(here / "set/tube/train/body_rest/c/0/0")
    out = here / "out"
    assert main(["predict", str(here / "model.safetensors"), str(here / "set"), "--out", str(out)]) == 2
    shown = capsys.readouterr()
    assert "1 of 2 clips failed" in shown.err
    assert "tube/train: " in shown.out
    assert [path.name for path in out.iterdir()] == ["tube__validation"]


def test_data_sets_of_another_version_are_not_added_to(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    set_attributes(here / "set", schema_version=9)
    before = sorted(here.joinpath("set").rglob("*"))
    for argv in (
        ["import", here / "clip.npz", "--split", "train", "--to", here / "set"],
        ["simulate", here / "simulation.yaml", "--out", here / "set"],
    ):
        refused(capsys, *argv, message="schema version 9")
    assert sorted(here.joinpath("set").rglob("*")) == before


# models

MODELS: dict[str, tuple[Callable[[Path], object], str]] = {
    "another version": (lambda m: set_header(m, format_version=9), "version 9"),
    "another architecture": (
        lambda m: set_header(m, network=json.loads(header(m))["network"] | {"blocks": 3}),
        "another architecture",
    ),
    "an unknown setting": (
        lambda m: set_header(m, network={"wings": 2}),
        "not a model that this version can read",
    ),
    "no header": (lambda m: save_file(load_file(m), m), "found None version None"),
    "a header of another kind": (lambda m: set_header(m, text="[1]"), "found None version None"),
    "cut short": (cut_short, "not a readable safetensors file"),
    "empty": (lambda m: m.write_bytes(b""), "not a readable safetensors file"),
    "weights not finite": (
        lambda m: save_file(
            {
                k: np.asarray(v * np.nan, v.dtype) if k.startswith("model.") else v
                for k, v in load_file(m).items()
            },
            m,
            metadata={"imgtransfer": header(m)},
        ),
        "weights that are not finite",
    ),
}


def header(path: Path) -> str:
    with safe_open(path, "numpy") as stored:
        return stored.metadata()["imgtransfer"]


def set_header(path: Path, text: str | None = None, **changed: object) -> None:
    text = text or json.dumps(json.loads(header(path)) | changed)
    save_file(load_file(path), path, metadata={"imgtransfer": text})


@pytest.mark.parametrize("fault", MODELS)
def test_models(here: Path, capsys: pytest.CaptureFixture[str], fault: str) -> None:
    spoil, message = MODELS[fault]
    spoil(here / "model.safetensors")
    out = here / "out"
    refused(
        capsys,
        "predict",
        here / "model.safetensors",
        here / "clip.npz",
        "--out",
        out,
        message=message,
        out=out,
    )


# maps, in both forms of fuse

MAPS: dict[str, tuple[Callable[[dict[str, np.ndarray]], dict[str, object]], str]] = {
    "cameras that look away": (
        lambda m: {"view_matrices": m["view_matrices"] * [[1], [1], [-1], [1]]},
        "view",
    ),
    "a flat camera": (lambda m: {"projection_matrices": 0 * m["projection_matrices"]}, ""),
    "an empty mask": (lambda m: {"mask": m["mask"] & False}, "outside the maps' silhouette"),
    "positions not finite": (lambda m: {"position": m["position"] * np.nan}, "position must be finite"),
    "positions as words": (lambda m: {"position": np.full(m["position"].shape, "x")}, "must be numbers"),
    "positions of one view": (lambda m: {"position": m["position"][:, :1]}, "of shape (6, 2, 64, 48, 3)"),
    "a template face out of range": (lambda _: {"template_faces": np.array([[0, 1, 999]])}, "[0, 1, 999]"),
    "a template without faces": (lambda _: {"template_faces": np.zeros((0, 3), int)}, "no faces"),
    "a box inside out": (lambda m: {"box_lo": m["box_hi"], "box_hi": m["box_lo"]}, "box"),
    "rotations that are none": (lambda m: {"rotation": 2 * m["rotation"]}, "rotation matrices"),
    "a frame rate in words": (lambda _: {"fps": np.array("fast")}, "fps must be one number"),
    "another version": (lambda _: {"format_version": np.array(9)}, "version 9"),
    "no mask": (lambda _: {"mask": None}, "mask missing"),
    "a clip": (lambda _: {"format": None}, "format 'imgtransfer-maps' version 1, 2, 3 or 4 expected"),
}


@pytest.mark.parametrize("fault", MAPS)
def test_maps(here: Path, capsys: pytest.CaptureFixture[str], fault: str) -> None:
    spoil, message = MAPS[fault]
    file, out = here / "p/clip/maps.npz", here / "out"
    with np.load(file) as stored:
        arrays = dict(stored)
    change(file, **spoil(arrays))
    refused(capsys, "fuse", "--maps", file, "--out", out, message=message, out=out)
    refused(capsys, "fuse", here / "p", message=message)
    assert sorted(path.name for path in (here / "p/clip").iterdir()) == ["maps.npz", "position_only.npz"]


def test_predictions_cut_short(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut_short(here / "p/clip/position_only.npz")
    refused(capsys, "fuse", here / "p", message="position_only.npz: not a readable npz")
    refused(
        capsys,
        "evaluate",
        here / "p",
        "--truth",
        here / "clip.npz",
        message="position_only.npz: not a readable",
    )
    cut_short(here / "p/clip/maps.npz")
    refused(
        capsys,
        "fuse",
        "--maps",
        here / "p/clip/maps.npz",
        "--out",
        here / "out",
        message="maps.npz: not a readable",
    )
    refused(capsys, "inspect", here / "p/clip/maps.npz", message="not a readable npz")


# configurations and options

YAML = {
    "simulate": ["simulate"],
    "train": ["train"],
    "fuse": ["fuse", "--maps", "p/clip/maps.npz", "--config"],
}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"wings: 2", "wings"),
        (b"fps: -1\nedge_steps: -1\ntraining: {steps: -1}", "found -1"),
        (b"1: 2", "1: "),
        (b"a: [", "YAML"),
        (b"\x80\x81", "YAML"),
    ],
)
@pytest.mark.parametrize("command", YAML)
def test_configurations(  # noqa: PLR0917
    here: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    content: bytes,
    message: str,
) -> None:
    monkeypatch.chdir(here)
    required = b"data: {source: x}\n" if command == "train" else b""
    (here / "c.yaml").write_bytes(required + content)
    refused(capsys, *YAML[command], "c.yaml", "--out", here / "out", message=message, out=here / "out")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("training.seed=-1", "training.seed"),
        ("training.threads=999999", "training.threads"),
        ("training.learning_rate=.nan", "training.learning_rate"),
        ("maps.size=[33, 32]", "33"),
        ("maps.views=[top]", "top"),
        ("data.train.names=[nothing]", "no clip matches"),
        ("data.source=elsewhere", "elsewhere: no such file"),
    ],
)
def test_training_settings(here: Path, capsys: pytest.CaptureFixture[str], change: str, message: str) -> None:
    argv = ("train", here / "run.yaml", "--set", change, "--out", here / "out")
    refused(capsys, *argv, message=message, out=here / "out")


def test_options_out_of_range(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, clip = here / "out", here / "clip.npz"
    for argv, message in (
        (["simulate", here / "simulation.yaml", "--workers", "0", "--out", out], "--workers 0"),
        (["simulate", here / "simulation.yaml", "--frames", "0", "--out", out], "--frames 0"),
        (["render", clip, "--size", "99999", "--out", out], "8192 pixels"),
        (["import", clip, "--split", "", "--to", out], "needs a split"),
        (["import", clip, "--split", "train", "--garment", "../up", "--to", out], "clip name"),
        (["inspect", clip, "--views", "above"], "views must be"),
    ):
        refused(capsys, *argv, message=message, out=out)


def test_a_file_where_a_folder_is_wanted(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, clip = here / "simulation.yaml", here / "clip.npz"
    for argv in (
        ["simulate", here / "simulation.yaml", "--out", file],
        ["train", here / "run.yaml", "--out", file],
        ["predict", here / "model.safetensors", clip, "--out", file],
        ["fuse", "--maps", here / "p/clip/maps.npz", "--out", file],
        ["render", clip, "--size", "32", "--out", file],
        ["import", clip, "--split", "train", "--to", file],
        ["export", clip, "--clip", "clip", "--out", file / "clip.npz"],
    ):
        refused(capsys, *argv, message="simulation.yaml")
    assert file.read_text() == SIMULATION


def test_what_cannot_be_parsed_is_refused_by_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    for argv in ([], ["knit"], ["predict", "a"], ["evaluate", "a", "--truth", "b", "--method", "guess"]):
        with pytest.raises(SystemExit) as stopped:
            main(argv)
        assert stopped.value.code == 2
        assert "error: " in capsys.readouterr().err


# a full disk

WRITERS: dict[str, tuple[list[object], str]] = {
    "predict": (["predict", "model.safetensors", "clip.npz", "--out", "out"], "out/clip/position_only.npz"),
    "render": (["render", "clip.npz", "--size", "32", "--out", "out"], "out/clip/body.npz"),
    "render exr": (
        ["render", "clip.npz", "--size", "128", "--format", "exr", "--out", "out"],
        "out/clip/body/00000.0.exr",
    ),
    "export npz": (["export", "clip.npz", "--out", "out/clip.npz"], "out/clip.npz"),
    "export glb": (["export", "clip.npz", "--out", "out/clip.glb"], "out/clip.glb"),
    "export obj": (["export", "clip.npz", "--out", "out"], "out"),
    "import": (["import", "clip.npz", "--split", "train", "--to", "out"], "out/clip/clip"),
}


@pytest.mark.parametrize("command", WRITERS)
def test_a_full_disk_is_one_line_that_names_the_file(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(here)
    argv, named = WRITERS[command]
    with full_disk(20_000 if command == "render exr" else 2000):
        refused(capsys, *argv, message=f"error: {named}: File too large")
    assert not Path(named).is_file()
    assert not list(here.rglob(".*"))


# packages that are not there

EXTRAS: dict[str, tuple[str, list[object], str]] = {
    "newton": (
        "newton",
        ["simulate", "simulation.yaml", "--out", "out"],
        "simulate needs the package newton",
    ),
    "gpytoolbox": ("gpytoolbox", ["simulate", "simulation.yaml", "--out", "out"], "the package gpytoolbox"),
    "ray": ("ray", ["fuse", "p", "--ray", "auto"], "imgtransfer[cluster]"),
    "aiohttp": ("aiohttp", ["inspect", "http://127.0.0.1:9/set"], "imgtransfer[remote]"),
}


@pytest.mark.parametrize("package", EXTRAS)
def test_a_missing_package_is_one_line_that_names_its_extra(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    monkeypatch.chdir(here)
    name, argv, message = EXTRAS[package]
    monkeypatch.setitem(sys.modules, name, None)  # type: ignore[arg-type] # as if it were not installed
    for loaded in [module for module in sys.modules if module.startswith("fsspec.implementations.http")]:
        monkeypatch.delitem(sys.modules, loaded)
    refused(capsys, *argv, message=message, out=here / "out")
