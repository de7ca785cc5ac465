"""The same thing by the same option in every command, and one line about what cannot be parsed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from imgtransfer.cli.main import build_parser, main
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.store import DataSet
from imgtransfer.pipeline.folder import MAPS_FILE


def refused(capsys: pytest.CaptureFixture[str], *argv: object) -> str:
    """The line that a command says before it ends with status 2."""
    capsys.readouterr()
    try:
        status: object = main([str(word) for word in argv])
    except SystemExit as stopped:  # what the parser refuses
        status = stopped.code
    error = capsys.readouterr().err
    assert status == 2
    assert error.count("\n") == 1
    return error


@pytest.fixture
def data(tmp_path: Path, tube_clip: Clip) -> Path:
    """Clips tube/a and tube/b for training, tube/c and tube/d for tests, of two frames each."""
    stored = DataSet.create(tmp_path / "data.zarr")
    for name, split in (("a", "train"), ("b", "train"), ("c", "test"), ("d", "test")):
        stored.write(f"tube/{name}", tube_clip.slice(slice(0, 2)), split=split)
    return tmp_path / "data.zarr"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["export", "data.zarr", "tube/a", "--out", "x"], "tube/a: one argument too many; clips are chosen by name"),
        (["export", "data.zarr", "--out", "x", "tube/*"], "with --clip 'tube/*' ("),
        (["doctor", "please"], "imgtransfer doctor: error: please: one argument too many (`imgtransfer doctor --h"),
        (["predict", "m", "s", "--out", "o", "--clips", "a"], "imgtransfer predict: error: there is no --clips, did "),
        (["predict", "m", "s", "--out", "o", "--over"], "there is no --over"),
        (["predict", "m", "s", "--out", "o", "--zzz=3"], "there is no --zzz ("),
        (["import", "meshes", "a", "--to", "x", "--facing", "-y"], "such as --facing=-y"),
        (["knit"], "invalid choice: 'knit' (choose from"),
        (["render", "a", "--out", "b", "--layers", "0"], "argument --layers: a whole number from 1 on is wanted"),
        (["export", "a", "--out", "b", "--step", "0"], "argument --step: a whole number from 1 on is wanted"),
    ],
)  # fmt: skip
def test_what_cannot_be_parsed_is_one_line(
    capsys: pytest.CaptureFixture[str], argv: list[str], message: str
) -> None:
    assert message in refused(capsys, *argv)


# --clip and --split


def test_export_chooses_a_clip_by_pattern_and_split(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(data), "--clip", "*/a", "--out", f"{tmp_path}/a.npz"]) == 0
    assert "tube/a: 2 of 2 frames" in capsys.readouterr().out
    choice = ["--split", "test", "--clip", "*[bd]"]
    assert main(["export", str(data), *choice, "--out", f"{tmp_path}/d.npz"]) == 0
    assert "tube/d" in capsys.readouterr().out
    assert "choose with --clip one of tube/c, tube/d" in refused(
        capsys, "export", data, "--split", "test", "--out", tmp_path / "x.npz"
    )
    assert not (tmp_path / "x.npz").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--out", "x.npz", "--step", "2"], "--step=2: a .npz holds every frame"),
        (["--out", "x.npz", "--frames-as", "ply"], "--frames-as=ply: goes with a folder"),
        (["--out", "x.glb", "--frames-as", "obj"], "--frames-as=obj: goes with a folder"),
    ],
)
def test_export_refuses_what_would_do_nothing(
    data: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert message in refused(capsys, "export", data, "--clip", "tube/a", *options)


def predicted(folder: Path, clips: str, clip: Clip) -> Path:
    """What `predict` leaves of clips, but for what is in the maps."""
    for name in clips:
        save_clip(folder / f"tube__{name}/position_only.npz", clip)
        (folder / f"tube__{name}/{MAPS_FILE}").touch()
    return folder


def test_fuse_takes_only_the_chosen_clips(
    tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = predicted(tmp_path / "p", "abc", tube_clip.slice(slice(0, 1)))
    assert "p: no clip matches (names tube/x); there are tube/a, tube/b, tube/c" in refused(
        capsys, "fuse", folder, "--clip", "tube/x"
    )
    assert "tube__b/maps.npz" in refused(capsys, "fuse", folder, "--clip", "*/b")  # the empty file
    assert "--clip goes with PREDICTIONS" in refused(
        capsys, "fuse", "--maps", folder / "tube__a/maps.npz", "--out", tmp_path / "o", "--clip", "a"
    )


def test_evaluate_says_only_what_the_predicted_split_lacks(
    data: Path, tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tube_clip.slice(slice(0, 2))
    folder = predicted(tmp_path / "p", "cd", clip)
    evaluate = ["evaluate", str(folder), "--truth", str(data)]
    assert main(evaluate) == 0
    assert "no prediction" not in capsys.readouterr().err
    shutil.rmtree(folder / "tube__d")
    assert main(evaluate) == 0
    assert "no prediction for 1 of 2 clips of the split test, left out: tube/d\n" in capsys.readouterr().err
    assert main(["evaluate", str(folder / "tube__c"), "--truth", str(data)]) == 0  # it was asked for alone
    assert "no prediction" not in capsys.readouterr().err


def test_evaluate_counts_what_a_folder_without_splits_lacks(
    tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tube_clip.slice(slice(0, 2))
    for name in "abcdefg":
        save_clip(tmp_path / f"truth/{name}.npz", clip)
    save_clip(tmp_path / "p/b/fused.npz", clip)
    assert main(["evaluate", f"{tmp_path}/p", "--truth", f"{tmp_path}/truth"]) == 0
    assert "no prediction for 6 of 7 clips, left out: a, c, d, e and 2 more\n" in capsys.readouterr().err


def test_evaluate_refuses_what_would_do_nothing(
    tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    save_clip(tmp_path / "a.npz", tube_clip.slice(slice(0, 2)))
    truth = ("--truth", tmp_path / "a.npz")
    assert "--method fused: says which predictions" in refused(
        capsys, "evaluate", "--baseline", "lbs", *truth, "--method", "fused"
    )
    assert "--method fused: chooses a file of a prediction's folder" in refused(
        capsys, "evaluate", tmp_path / "a.npz", *truth, "--method", "fused"
    )


def test_inspect_refuses_what_would_do_nothing(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.safetensors").touch()
    for options in (["--clip", "a"], ["--split", "test"], ["--views", "four"], ["--html", "x.html"]):
        message = f"{options[0]} goes with clips; {tmp_path / 'model.safetensors'} is a checkpoint"
        assert message in refused(capsys, "inspect", tmp_path / "model.safetensors", *options)
    assert "--workers and --ray go with --html" in refused(capsys, "inspect", data, "--workers", "2")


# --set


def test_every_command_with_a_configuration_has_set() -> None:
    for argv in (
        ["train", "a.yaml", "--set", "training.steps=1", "--set", "training.seed=2"],
        ["fuse", "p", "--set", "weight_edge=1", "--set", "solver=adam"],
        ["simulate", "--out", "x", "--set", "fps=1", "--set", "cloth.fabric=silk"],
    ):
        assert build_parser().parse_args(argv).set == [argv[-3], argv[-1]]


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["fuse", "p", "--set", "wieght_edge=1"], "--set wieght_edge=1: wieght_edge: no such setting, did you "),
        (["fuse", "p", "--solver", "adam", "--set", "solver=adam"], "--solver decides what --set solver=adam would"),
        (["train", "c.yaml", "--data", "x", "--set", "data.source=y"], "--data decides what --set data.source=y would"),
        (["simulate", "--out", "x", "--set", "fps=0"], "--set fps=0: fps: a number from 0.01 to 10000 is wanted"),
        (["simulate", "--out", "x", "--set", "cloth.fabric=silk"], "nothing to simulate"),
        (["simulate", "--out", "x", "--fps", "25", "--set", "sequences.fps=24"], "--fps decides what --set sequences."),
        (["simulate", "--out", "x", "--template", "a.obj", "--set", "garment.kind=skirt"], "--template decides what"),
        (["simulate", "--out", "x", "--unit", "cm", "--set", "sequences.scale=1"], "--unit decides what --set seq"),
    ],
)  # fmt: skip
def test_wrong_changes_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    argv: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text("data: {source: x}")
    assert message in refused(capsys, *argv)
    assert not (tmp_path / "x").exists()


def test_a_path_that_looks_like_yaml_stays_a_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text("{}")
    for path in ("2024", "a: b", "[x"):
        assert f"{path}: no such file or folder" in refused(capsys, "train", "c.yaml", "--data", path)
