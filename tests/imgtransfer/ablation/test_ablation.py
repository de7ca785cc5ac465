"""Ablations: rows as changes of one method, each training once, tables over seeds, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imgtransfer.ablation.config import AblationConfig, merged
from imgtransfer.ablation.fusion_terms import TERMS, fused_with
from imgtransfer.ablation.table import ablation_table
from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config
from imgtransfer.data.clip import save_clip
from render import InputError, load_maps
from tests.helpers.paths import ROOT
from tests.helpers.synthetic import tube_clip

TINY = """
data:
  name: tube
  source: clips
  train: {split: null, names: [a]}
  validation: {split: null, names: [a]}
  test: {split: null, names: [b]}
method:
  name: image_transfer
  maps: {size: [32, 32]}
  network: {encoder: {kind: vit, patch: 8, dim: 16, depth: 1, heads: 2}, blocks: 1, heads: 2, target: residual}
  training: {steps: 2, batch_frames: 2}
seeds: [0, 1]
rows:
"""
ROWS = """
  - {label: ours}
  - {label: added, changes: {network: {attention: added}}}
  - {label: edge lengths, terms: edge lengths}
  - {label: PointNet, method: {name: pointnet, steps: 2, batch_frames: 2, features: 8}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "clips").mkdir()
    for name in "ab":
        save_clip(tmp_path / f"clips/{name}.npz", tube_clip(frames=4 if name == "a" else 2, name=name))
    (tmp_path / "tiny.yaml").write_text(TINY + ROWS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_changes_go_into_their_sections() -> None:
    base = {"a": 1, "network": {"x": 1, "encoder": {"kind": "vit", "dim": 8}}}
    assert merged(base, {"network": {"x": 2}}) == {
        "a": 1,
        "network": {"x": 2, "encoder": {"kind": "vit", "dim": 8}},
    }
    assert merged(base, {"network": {"encoder": {"dim": 4}}})["network"]["encoder"] == {
        "kind": "vit",
        "dim": 4,
    }
    other = merged(base, {"network": {"encoder": {"kind": "hub"}}})  # another kind has other settings
    assert other["network"]["encoder"] == {"kind": "hub"}
    assert base["network"] == {"x": 1, "encoder": {"kind": "vit", "dim": 8}}


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs/ablation").glob("*.yaml")), ids=lambda path: path.stem
)
def test_the_files_that_come_along_are_right(path: Path) -> None:
    load_config(AblationConfig, path, []).check(str(path))


def test_all_tables_of_one_base_share_its_trainings() -> None:
    tables = [load_config(AblationConfig, path, []) for path in (ROOT / "configs/ablation").glob("*.yaml")]
    assert len({table.method.model_dump_json() for table in tables}) == 1


def test_rows_are_trained_once_and_measured(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "other.yaml").write_text(TINY + "  - {label: again}\n")
    command = ["ablate", "tiny.yaml", "other.yaml", "--out", "out"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    fits = sorted(path.name for path in (folder / "out/fits").iterdir())
    assert (
        len(fits) == 6
    )  # ours, added and PointNet, of two seeds: the fusion's row and the other table train nothing
    results = json.loads((folder / "out/results.json").read_text())
    rows = results["tables"]["tiny"]["rows"]
    assert list(rows) == ["ours", "added", "edge lengths", "PointNet"]
    assert rows["ours"] == results["tables"]["other"]["rows"]["again"]
    assert rows["ours"]["0"]["overall"] != rows["ours"]["1"]["overall"]
    for name in ("ours", "added", "edge lengths", "PointNet + fusion"):
        assert re.search(rf"^{re.escape(name)} +[0-9.]+ ± [0-9.]+ ", shown, re.MULTILINE), name
    assert "tables   out/tables.md" in shown
    assert "2 steps; seeds 0, 1" in (folder / "out/tables.md").read_text()
    stamps = {path: path.stat().st_mtime_ns for path in (folder / "out/fits").rglob("*.json")}
    assert main(command) == 0  # nothing is made again
    assert stamps == {path: path.stat().st_mtime_ns for path in (folder / "out/fits").rglob("*.json")}


def test_terms_of_the_fusion_are_what_they_say(folder: Path) -> None:
    rows = "rows=[{label: ours}]"
    assert main(["ablate", "tiny.yaml", "--set", "seeds=[0]", "--set", rows, "--out", "out"]) == 0
    maps = next((folder / "out/fits").glob("image_transfer-*/predictions/b/maps.npz"))
    config = load_config(AblationConfig, folder / "tiny.yaml", [])
    assert config.rows[2].terms in TERMS
    from fusion import FusionConfig  # noqa: PLC0415

    clip = tube_clip(frames=2, name="b")
    found = {terms: fused_with(load_maps(maps), clip, terms, FusionConfig()) for terms in TERMS}
    initial = found.pop("initialisation")
    for terms, vertices in found.items():
        assert np.abs(vertices - initial).max() > 1e-5, terms


def table(values: dict[str, list[float]], others: tuple[str, ...] = ()) -> dict[str, Any]:
    def run(value: float) -> dict[str, Any]:
        metrics = {"rmse_mm": value, "hausdorff_mm": 1.0, "sted": 0.5, "crossing_percent": 0.0}
        return {"overall": {"position_only": metrics, "fused": metrics}, "fit_seconds": 10.0 * value}

    rows = [{"label": label, "method": {"name": "gcn"} if label in others else None} for label in values]
    by_seed = {label: {str(i): run(v) for i, v in enumerate(found)} for label, found in values.items()}
    return {"config": {"rows": rows}, "rows": by_seed}


def test_a_table_has_means_and_their_spread() -> None:
    lines = ablation_table(table({"ours": [1.0, 3.0], "GCN": [2.0]}, others=("GCN",))).splitlines()[2:]
    assert [line.split("  ")[0] for line in lines] == ["ours", "GCN", "GCN + fusion"]
    assert "2.00 ± 1.41" in lines[0]  # the sample's standard deviation of 1 and 3 is the root of 2
    assert "0.5000 ± 0.0000" in lines[0]
    assert lines[0].split()[-2:] == ["20", "2"]
    assert "±" not in lines[1]  # of one run no spread is known


@pytest.mark.parametrize(("rows", "message"), [
    ("  - {label: a}\n  - {label: a}\n", "two are called a"),
    ("  - {label: a, terms: half}\n", "terms half must be one of initialisation, edge lengths"),
    ("  - {label: a, terms: full, changes: {seed: 1}}\n", "changes and terms exclude each other"),
    ("  - {label: a, changes: {training: {steps: 9}}}\n", "changes training.steps, and all rows have one budget"),
    ("  - {label: a, changes: {network: {attention: none}}}\n", "attention"),
    ("  - {label: a, method: {name: nosuch}}\n", "nosuch"),
])  # fmt: skip
def test_rows_that_are_wrong_are_one_line(
    rows: str, message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "bad.yaml").write_text(TINY + rows)
    assert main(["ablate", "bad.yaml", "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "out").exists()


def test_two_files_of_one_name_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "sub").mkdir()
    (folder / "sub/tiny.yaml").write_text(TINY + ROWS)
    assert main(["ablate", "tiny.yaml", "sub/tiny.yaml"]) == 2
    assert "two tables are called tiny" in capsys.readouterr().err


def test_clips_that_are_not_there(folder: Path) -> None:
    config = load_config(AblationConfig, folder / "tiny.yaml", ["data.test.names=[z]"])
    from imgtransfer.ablation.run import run_ablations  # noqa: PLC0415
    from imgtransfer.running import executor_for  # noqa: PLC0415

    with pytest.raises(InputError, match="z"):
        run_ablations({"tiny": config}, folder / "out", executor=executor_for())
