"""Completion in real shells: commands, options, their values, files."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from imgtransfer.cli.completion import completion_of
from imgtransfer.cli.main import COMMANDS, main

ASK = """
source ./script || exit 1
complete -p imgtransfer > /dev/null || exit 1
while IFS= read -r line; do
  IFS=' ' read -r -a COMP_WORDS <<< "$line."
  last=$(( ${#COMP_WORDS[@]} - 1 )); COMP_WORDS[last]=${COMP_WORDS[last]%.}
  COMP_CWORD=$last; COMP_LINE=$line; COMP_POINT=${#line}; COMPREPLY=()
  $(complete -p imgtransfer | sed 's/.*-F \\([^ ]*\\).*/\\1/') imgtransfer "${COMP_WORDS[last]}" "${COMP_WORDS[last-1]}"
  echo "${COMPREPLY[@]}"
done < lines
"""


@pytest.fixture
def shell(tmp_path: Path) -> Path:
    """A folder with the script for bash, two files and a folder."""
    (tmp_path / "script").write_text(completion_of("bash"))
    (tmp_path / "walk.npz").touch()
    (tmp_path / "walking").mkdir()
    (tmp_path / "other.npz").touch()
    return tmp_path


def completed(folder: Path, *lines: str) -> list[set[str]]:
    """What bash offers at the end of each line."""
    (folder / "lines").write_text("".join(f"{line}\n" for line in lines))
    done = subprocess.run(
        ["bash", "--norc", "-c", ASK], cwd=folder, capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stderr == ""
    return [set(line.split()) for line in done.stdout.splitlines()]


def test_bash_offers_commands_options_values_and_files(shell: Path) -> None:
    commands, some, options, values, files, option_files = completed(
        shell,
        "imgtransfer ",
        "imgtransfer ex",
        "imgtransfer doctor --",
        "imgtransfer completion ",
        "imgtransfer inspect wal",
        "imgtransfer evaluate --truth wal",
    )
    assert commands >= {name.rstrip("_") for name in COMMANDS}
    assert some == {"export"}
    assert options >= {"--help", "--report"}
    assert values >= {"bash", "zsh"}
    assert "export" not in values
    assert files == option_files == {"walk.npz", "walking"}


def test_zsh_has_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "zsh"]) == 0
    script = capsys.readouterr().out
    assert script.startswith("#compdef imgtransfer\n")
    assert "    doctor:'report what works on this machine'\n" in script
    for name in COMMANDS:
        assert f"    {name.rstrip('_')}:'" in script


def test_zsh_parses_it(tmp_path: Path) -> None:
    zsh = shutil.which("zsh")
    assert zsh is not None, "scripts/test installs zsh"
    (tmp_path / "_imgtransfer").write_text(completion_of("zsh"))
    subprocess.run([zsh, "-n", tmp_path / "_imgtransfer"], check=True, timeout=60)


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["completion", "tcsh"])
    error = capsys.readouterr().err
    assert "tcsh" in error
    assert "zsh" in error
