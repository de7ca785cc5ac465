"""A Python with Blender in it (`bpy`), in an environment of its own: nobody's installation is changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.helpers.paths import ROOT

VERSION = "5.0.1"
ENVIRONMENT = ROOT / ".blender"
VARIABLE = "BLENDER_PYTHON"  # names a Python that has bpy already


def blender_python() -> Path:
    """The interpreter; makes the environment where there is none (half a gigabyte is fetched once)."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    python = ENVIRONMENT / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True)
    probe = subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False)
    if probe.returncode:
        subprocess.run([python, "-m", "pip", "install", "--quiet", f"bpy=={VERSION}"], check=True)
    return python


def run_blender(program: Path, *arguments: object) -> None:
    """Run a program in Blender's Python; its whole output is in the error where it fails."""
    argv = [str(blender_python()), str(program), *(str(argument) for argument in arguments)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
