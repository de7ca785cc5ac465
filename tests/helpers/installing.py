"""A virtual environment with our wheel and what it needs, made without a network from what is installed here."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from tests.helpers.paths import ROOT

PROJECT = "imgtransfer"


def needed(name: str = PROJECT) -> set[str]:
    """Names of the packages that one needs here, and those that these need; without those of extras."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        package = waiting.pop()
        for requirement in distribution(package).requires or ():
            if "extra ==" in requirement:
                continue
            (other,) = re.findall(r"^[\w.-]+", requirement)
            try:
                known = distribution(other).name
            except PackageNotFoundError:  # of another system or Python
                continue
            if known not in found:
                found.add(known)
                waiting.append(known)
    return found


def environment_with(wheel: Path, folder: Path) -> Path:
    """Make an environment in which the wheel is installed beside its core dependencies alone; returns its `bin`."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    for name in needed() - {PROJECT}:
        installed = distribution(name)
        for top in {
            path.parts[0] for path in installed.files or () if path.parts[0] not in ("..", "__pycache__")
        }:
            if not (packages / top).exists():
                (packages / top).symlink_to(Path(str(installed.locate_file(top))).resolve())
    python = folder / "bin" / "python"
    _output([sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel])
    return folder / "bin"


def add_extra(wheel: Path, extra: str, programs: Path) -> set[str]:
    """Let pip install an extra of the wheel from the package index, beside what is there; returns its packages' names.

    They come into a folder of their own, as those of the environment are links to what is installed here.

    Args:
        programs: `bin` of an environment from `environment_with`.
    """
    pip = [sys.executable, "-m", "pip", "--python", programs / "python", "install", "--quiet"]
    pinned = ["--constraint", ROOT / "constraints.txt"]
    wanted = [*pip, *pinned, "--dry-run", "--report", "-", f"{wheel}[{extra}]"]
    report = json.loads(_output(wanted))["install"]
    found = {one["metadata"]["name"]: one["metadata"]["version"] for one in report}
    found.pop(PROJECT, None)
    assert not found.keys() & needed(), "another version of what the wheel needs by itself"
    (packages,) = programs.parent.glob("lib/python*/site-packages")
    added = programs.parent / "added"
    _output([*pip, "--no-deps", "--target", added, *(f"{name}=={number}" for name, number in found.items())])
    (packages / "added.pth").write_text(f"{added}\n")
    return set(found)


def _output(words: list[object]) -> str:
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout
