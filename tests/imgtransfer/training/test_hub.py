"""Models in the hub's conventions: written from a run, read by path and by name, and a hub that gives nothing."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
import torch
import yaml
from huggingface_hub import constants

from imgtransfer.cli.main import main
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.hub import from_pretrained, model_path, save_pretrained
from imgtransfer.training.loop import train
from render import InputError
from tests.helpers.paths import ROOT
from tests.helpers.training import small_config


@pytest.fixture(scope="module")
def run(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three steps, the first of which is the best: read only."""
    folder = tmp_path_factory.mktemp("hub") / "run"
    train(small_config(source, steps=3, validate_every_steps=1, learning_rate=1e-3), folder)
    return folder


def test_a_folder_for_the_hub_is_read_as_the_run_is(run: Path, source: Path, tmp_path: Path) -> None:
    folder = save_pretrained(run, tmp_path / "shirt", licence="cc0-1.0", data="tubes")
    assert sorted(path.name for path in folder.iterdir()) == ["README.md", "config.json", "model.safetensors"]
    wanted, found = load_model(run).state_dict(), from_pretrained(folder).state_dict()
    assert all(torch.equal(wanted[key], found[key]) for key in wanted)
    config = json.loads((folder / "config.json").read_text())
    assert (config["model_type"], config["steps"]) == ("imgtransfer", 3)
    assert config["network"]["encoder"]["dim"] == 16
    assert main(["predict", str(folder), str(source), "--out", str(tmp_path / "out")]) == 0


def test_the_card_is_filled_in(run: Path, tmp_path: Path) -> None:
    card = (
        save_pretrained(run, tmp_path / "shirt", licence="cc0-1.0", data="tubes") / "README.md"
    ).read_text()
    _, front, text = card.split("---\n", 2)
    assert yaml.safe_load(front)["license"] == "cc0-1.0"
    last = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()][-1]
    for line in (
        "# shirt",
        "| data | tubes (1 clips, 6 frames, 1 garments) |",
        "| steps | 3 of 2 frames in each process |",
        f"| position maps: mean distance, mm | {last['position_mm']:.3g} |",
        "The weights: cc0-1.0.",
    ):
        assert line in text


def test_the_best_model_is_published_with_its_own_numbers(run: Path, tmp_path: Path) -> None:
    folder = save_pretrained(run, tmp_path / "best", licence="cc0-1.0", which="best")
    step = json.loads((folder / "config.json").read_text())["steps"]
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert (
        f"| position maps: mean distance, mm | {lines[step]['position_mm']:.3g} |"
        in (folder / "README.md").read_text()
    )
    with pytest.raises(InputError, match=r"best.safetensors: no such file"):
        save_pretrained(tmp_path, tmp_path / "other", licence="other", which="best")


def test_the_python_of_the_page_on_training_runs(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "training.md").read_text()
    (program,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "demo").symlink_to(run)
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    exec(compile(program, "docs/training.md", "exec"), space)
    assert isinstance(space["model"], torch.nn.Module)
    assert (tmp_path / "my-shirt" / "model.safetensors").is_file()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of the hub's client, which may not ask the hub."""
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache"


def test_a_model_that_was_fetched_before_is_read_by_its_name(run: Path, cache: Path, tmp_path: Path) -> None:
    repository = cache / "models--someone--shirt"
    folder = save_pretrained(run, tmp_path / "shirt", licence="cc0-1.0")
    shutil.copytree(folder, repository / "snapshots" / ("a" * 40))
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text("a" * 40)
    assert from_pretrained("someone/shirt").general is False


def test_a_hub_that_gives_nothing_is_one_line(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", "someone/trousers", "clips", "--out", "out"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert (
        "error: someone/trousers: no such file or folder, and the Hugging Face hub gives no model of that name"
        in error
    )
    assert "hf download someone/trousers" in error


def test_a_path_is_never_asked_for(cache: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    for path in ("runs/demo", "model.safetensors", "someone/model.safetensors", "a/b/c", str(tmp_path / "x")):
        assert model_path(path) == Path(path)
