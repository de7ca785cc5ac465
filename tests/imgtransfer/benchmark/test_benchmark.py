"""A benchmark of tubes: run, run again, with another program's predictions, and refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.benchmark.tables import row_name
from imgtransfer.cli.main import main
from imgtransfer.data.clip import save_clip
from imgtransfer.deformers import load_deformer
from tests.helpers.pages import check_page
from tests.helpers.synthetic import tube_clip

CONFIG = """
data: [{name: tube, source: clips, train: {names: [one]}, test: {names: [two, six]}}]
methods:
  - {name: lbs}
  - {name: lbs, label: nearest, neighbours: 1, diffusion: 0}
  - {name: pose_regression, steps: 3}
pictures: 0
played: 0
fuse: false
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three clips and a benchmark's configuration, in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name, frames in (("one", 5), ("two", 2), ("six", 6)):
        save_clip(f"clips/{name}.npz", tube_clip(frames))
    Path("bench.yaml").write_text(CONFIG)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    capsys.readouterr()
    assert main(["benchmark", *argv]) == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error


def test_every_method_is_trained_and_measured_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine").mkdir()
    for name, frames in (("two", 2), ("six", 6)):
        np.savez(f"mine/{name}.npz", garment_vertices=tube_clip(frames).garment.vertices)
    command = ["benchmark", "bench.yaml", "--out", "out", "--predictions", "mine=mine"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "page     out/report.html" in shown
    results = json.loads(Path("out/results.json").read_text())
    rows = {row["row"]: row for row in results["results"]}
    assert list(rows) == ["lbs", "nearest", "pose_regression", "mine"]
    assert rows["mine"]["overall"]["rmse_mm"] == 0
    assert rows["mine"]["parameters"] is None
    assert rows["lbs"]["frames"] == {"two": 2, "six": 6}
    assert rows["lbs"]["parameters"] == load_deformer("out/tube/lbs/run").parameters()
    assert rows["lbs"]["ms"].keys() == {"predict"}
    assert rows["lbs"]["fit_seconds"] > 0
    values = [rows["lbs"]["clips"][name]["rmse_mm"] for name in ("two", "six")]
    assert rows["lbs"]["overall"]["rmse_mm"] == pytest.approx((2 * values[0] + 6 * values[1]) / 8)
    assert results["data"]["tube"]["train"] == ["one"]
    assert results["data"]["tube"]["test"] == ["six", "two"]
    for row in rows:
        assert row in Path("out/tables.md").read_text()
        assert row.replace("_", r"\_") in Path("out/tables.tex").read_text()
    page = Path("out/report.html").read_text()
    assert all(row in page for row in rows)
    assert not Path("out/pictures").exists()
    before = Path("out/tube/pose_regression/run/model.safetensors").stat().st_mtime_ns
    assert main([*command, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["results"] == results["results"]
    assert Path("out/tube/pose_regression/run/model.safetensors").stat().st_mtime_ns == before


def test_the_page_shows_and_plays_every_method_and_needs_nothing_else(folder: Path) -> None:
    changes = ["pictures=1", "played=1", "data.0.test.names=[two]"]
    options = ["--out", "out", "--methods", "lbs"]
    assert (
        main(["benchmark", "bench.yaml", *options, *(word for one in changes for word in ("--set", one))])
        == 0
    )
    page = Path("out/report.html").read_text()
    assert page.count('class="frame"') == 2  # the method, and the truth
    assert page.count("data:image/webp;base64,") == 3  # and the drawn frames of both
    assert "http" not in page
    assert Path("out/pictures/tube__two.png").is_file()
    check_page(Path("out/report.html"))


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["bench.yaml", "--methods", "lbs,knit"], "--methods knit: no such method; there are lbs, nearest"),
        (["bench.yaml", "--predictions", "mine"], "NAME=FOLDER is wanted"),
        (["bench.yaml", "--predictions", "lbs=clips"], "a method is called so already"),
        (["bench.yaml", "--data", "none"], "none: no such file or folder"),
        (["bench.yaml", "--set", "methods.1.label=lbs"], "two are called lbs"),
        (["bench.yaml", "--set", "methods.1.name=knit"], "methods.1: method.name: no method 'knit'"),
        (["bench.yaml", "--set", "methods.1.neighbours=0"], "method.neighbours: a whole number from 1"),
        (["bench.yaml", "--set", "methods.1={label: a}"], "methods.1: method"),
        (["bench.yaml", "--set", "data.0.test.names=[one]"], "is to be fitted to and measured"),
        (["bench.yaml", "--set", "data=[]"], "data"),
        (["none.yaml"], "none.yaml: no such file; the YAML of a benchmark"),
    ],
)
def test_what_nobody_means_is_refused_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str], argv: list[str], message: str
) -> None:
    error = refused(capsys, *argv, "--out", "out")
    assert message in error
    assert error.count("\n") == 1
    assert not Path("out").exists()


def test_predictions_that_lack_a_clip_fail_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine").mkdir()
    np.savez("mine/two.npz", garment_vertices=tube_clip(2).garment.vertices)
    options = ["--out", "out", "--methods", "lbs", "--predictions", "mine=mine"]
    assert "no prediction of six; wanted is six.npz" in refused(capsys, "bench.yaml", *options)
    results = json.loads(Path("out/results.json").read_text())
    assert [row["row"] for row in results["results"]] == ["lbs"]
    assert list(results["failures"]) == ["tube: mine"]


def test_the_fusion_is_an_addition_to_all_but_our_own() -> None:
    assert row_name("lbs", "fused", network=False) == "lbs + fusion"
    assert row_name("lbs", "position_only", network=False) == "lbs"
    assert row_name("image_transfer", "fused", network=True) == "image_transfer"
    assert row_name("image_transfer", "position_only", network=True) == "image_transfer, position maps alone"
