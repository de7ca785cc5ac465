"""`imgtransfer config`: what it prints is what the other commands take."""

from __future__ import annotations

from pathlib import Path

import pytest

from fusion import FusionConfig
from imgtransfer.cli.config import schema_of
from imgtransfer.cli.main import main
from imgtransfer.config.loader import load_config
from tests.helpers.paths import ROOT

DEMO = str(ROOT / "configs" / "demo.yaml")


def printed(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    capsys.readouterr()
    assert main(["config", *argv]) == 0
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    capsys.readouterr()
    assert main([*argv]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize(
    ("command", "changes"), [("fuse", []), ("simulate", []), ("train", ["data.source=x"])]
)
def test_what_is_printed_is_a_configuration_of_defaults(
    command: str, changes: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "printed.yaml"
    path.write_text(printed(capsys, command))
    schema = schema_of(command)
    assert load_config(schema, path, changes) == load_config(schema, None, changes)


def test_the_commands_take_what_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They get as far as what the configuration does not say."""
    files = {}
    for command in ("fuse", "simulate", "train"):
        files[command] = tmp_path / f"{command}.yaml"
        files[command].write_text(printed(capsys, command))
    maps, out, none = str(tmp_path / "none.npz"), str(tmp_path / "out"), str(tmp_path / "none")
    assert "none.npz" in refused(capsys, "fuse", "--maps", maps, "--config", str(files["fuse"]), "--out", out)
    assert "nothing to simulate" in refused(capsys, "simulate", str(files["simulate"]), "--out", out)
    assert "data.source: missing" in refused(capsys, "train", str(files["train"]), "--out", out)
    assert none in refused(capsys, "train", str(files["train"]), "--data", none, "--out", out)


def test_a_file_and_changes_are_shown_with_the_defaults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed(capsys, "train", DEMO, "--set", "training.steps=7", "--set", "training.threads=null")
    assert "default 100000]\n  steps: 7\n" in text
    assert "  threads: null\n" in text
    assert "  weight_decay: 0.01\n" in text
    path = tmp_path / "shown.yaml"
    path.write_text(text)
    changes = ["training.steps=7", "training.threads=null"]
    schema = schema_of("train")
    assert load_config(schema, path) == load_config(schema, DEMO, changes)


def test_changes_alone_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "shown.yaml"
    path.write_text(printed(capsys, "fuse", "--set", "weight_edge=50"))
    assert load_config(FusionConfig, path) == FusionConfig(weight_edge=50)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["train", "none.yaml"], "none.yaml: no such file; the YAML of a training run"),
        (["fuse", "none.yaml"], "none.yaml: no such file; YAML with hyper-parameters of the fusion"),
        (["simulate", "none.yaml"], "none.yaml: no such file; a YAML file such as configs/data/sample.yaml"),
        (["fuse", "--set", "wieght_edge=3"], "wieght_edge=3: wieght_edge: no such setting, did you mean weight_edge?"),
        (["fuse", DEMO], "demo.yaml: data: no such setting"),
    ],
)  # fmt: skip
def test_mistakes_are_those_of_the_command_itself(
    argv: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, "config", *argv)
