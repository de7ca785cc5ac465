"""The layers of docs/architecture.md: imports point left only, and what is heavy stays out until it is used."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import render
from tests.helpers.paths import ROOT

LAYERS = ("render", "fusion", "imgtransfer")  # each may import itself and those before it
HEAVY = ("anny", "glcontext", "moderngl", "newton", "warp")


def imported_packages(file: Path) -> set[str]:
    """Top-level names of everything that a module imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import; packages are named in full here"
            found.add((node.module or "").partition(".")[0])
    return found


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_point_left_only(layer: str) -> None:
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    forbidden = set(LAYERS[LAYERS.index(layer) + 1 :])
    wrong = {
        str(file.relative_to(ROOT)): found for file in files if (found := imported_packages(file) & forbidden)
    }
    assert wrong == {}


@pytest.mark.parametrize("package", [*LAYERS, "imgtransfer.cli.main"])
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    program = f"import sys, {package}; print(*sorted(set(sys.modules) & set({HEAVY!r})))"
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert found.stdout.split() == []


def test_help_does_not_wait_for_pytorch() -> None:
    program = "import sys, imgtransfer.cli.main as m; m.build_parser(); print('torch' in sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert found.stdout.split() == ["False"]


def test_render_offers_what_its_type_checked_list_names() -> None:
    tree = ast.parse((ROOT / "render" / "__init__.py").read_text(encoding="utf-8"))
    listed = {
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("render.")
        for alias in node.names
    }
    assert len(listed) > 15
    for module, name in listed:
        assert getattr(render, name) is getattr(importlib.import_module(module), name)


@pytest.mark.parametrize("layer", LAYERS)
def test_modules_stay_readable(layer: str) -> None:
    long = {
        str(file.relative_to(ROOT)): lines
        for file in sorted((ROOT / layer).rglob("*.py"))
        if (lines := len(file.read_text(encoding="utf-8").splitlines())) > 500
    }
    assert long == {}
