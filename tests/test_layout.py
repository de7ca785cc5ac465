"""The layers and surfaces of docs/architecture.md, and what is heavy stays out until it is used."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.paths import ROOT

LAYERS = ("render", "fusion", "imgtransfer")  # the import contracts in pyproject.toml hold their order
HEAVY = ("anny", "glcontext", "moderngl", "newton", "warp")
PACKAGES = sorted(file.parent for layer in LAYERS for file in (ROOT / layer).rglob("__init__.py"))
MOST_LINES = 350


def name_of(package: Path) -> str:
    return ".".join(package.relative_to(ROOT).parts)


@pytest.mark.parametrize("package", [*LAYERS, "imgtransfer.cli.main"])
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    program = f"import sys, {package}; print(*sorted(set(sys.modules) & set({HEAVY!r})))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.split() == []


def test_help_does_not_wait_for_pytorch() -> None:
    program = "import sys, imgtransfer.cli.main as m; m.build_parser(); print('torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.split() == ["False"]


@pytest.mark.parametrize("package", PACKAGES, ids=name_of)
def test_a_package_says_what_it_is_and_offers_what_it_names(package: Path) -> None:
    module = importlib.import_module(name_of(package))
    assert module.__doc__
    stub = package / "__init__.pyi"
    if not stub.is_file():
        assert (
            len(ast.parse((package / "__init__.py").read_text(encoding="utf-8")).body) == 1
        )  # a docstring alone
        return
    offered = {
        (node.module, alias.name)
        for node in ast.parse(stub.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {name for _, name in offered} == set(module.__all__)
    for home, name in offered:
        value = getattr(module, name)
        assert value is getattr(importlib.import_module(f"{module.__name__}.{home}"), name)
        if inspect.isclass(value) or inspect.isroutine(value):
            assert value.__doc__, f"{module.__name__}.{name} is public and not documented"
        # A function of a module's name would hide the module from `import package.module as m`.
        assert not (package / f"{name}.py").exists(), name


def test_no_module_lies_loose_beside_the_packages() -> None:
    assert [file.name for file in (ROOT / "imgtransfer").glob("*.py")] == ["__init__.py"]


@pytest.mark.parametrize("layer", LAYERS)
def test_modules_stay_readable(layer: str) -> None:
    long = {
        str(file.relative_to(ROOT)): lines
        for file in sorted((ROOT / layer).rglob("*.py"))
        if (lines := len(file.read_text(encoding="utf-8").splitlines())) > MOST_LINES
    }
    assert long == {}
