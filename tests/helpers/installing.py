"""A virtual environment with our wheel and what it needs, made without a network from what is installed here."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

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
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel]
    subprocess.run([*map(str, install)], check=True, capture_output=True)
    return folder / "bin"
