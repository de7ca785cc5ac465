"""A hint always names something that exists in the command that gives it: a flag, or a key of its configuration."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from imgtransfer.bodies.config import SmplConfig
from imgtransfer.cli import dress
from imgtransfer.cli.main import build_parser
from imgtransfer.cli.simulate import as_option, as_option_with_template
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.running.messages import as_flag
from imgtransfer.simulation.motion_config import FileMotions
from render.options import Naming, Option
from tests.helpers.paths import ROOT

MESHES = ("import", "render", "fuse", "simulate", "dress")
# Which commands run what a module says; the longest path that fits counts.
COMMANDS = {
    "imgtransfer/config": ("simulate", "train", "fuse", "config"),
    "imgtransfer/training": ("train",),
    "imgtransfer/benchmark": ("benchmark",),
    "imgtransfer/deformers": ("train",),
    "imgtransfer/deformers/base.py": ("predict",),
    "imgtransfer/deformers/predict.py": ("predict",),
    "imgtransfer/running": ("simulate", "predict", "fuse", "inspect"),
    "imgtransfer/exports": ("export",),
    "imgtransfer/dressing": ("dress",),
    "imgtransfer/pipeline/fuse.py": ("fuse",),
    "imgtransfer/pipeline/fuse_notes.py": ("fuse",),
    "imgtransfer/pipeline/fuse_summary.py": ("fuse",),
    "imgtransfer/pipeline/fuse_task.py": ("fuse",),
    "imgtransfer/pipeline/folder.py": ("fuse",),
    "imgtransfer/pipeline/predict.py": ("predict",),
    "imgtransfer/pipeline/render.py": ("render",),
    "imgtransfer/pipeline/scene.py": ("render",),
    "imgtransfer/importers/checks": ("import", "simulate", "dress"),
    "imgtransfer/importers/checks/axes.py": MESHES,
    "imgtransfer/importers/checks/motion.py": MESHES,
    "imgtransfer/importers/checks/weld.py": MESHES,
    "imgtransfer/importers/formats": ("import",),
    "imgtransfer/importers/pickles": ("import", "simulate"),
    "imgtransfer/importers/smpl.py": ("import", "simulate", "dress"),
    "imgtransfer/importers/summary.py": ("import", "simulate"),
    "imgtransfer/simulation": ("simulate",),
    "imgtransfer/simulation/hang.py": ("predict", "dress"),
    "imgtransfer/network/shapes.py": ("predict", "dress"),
    "imgtransfer/viewing": ("view",),
    "imgtransfer/motions": ("simulate", "dress"),
    "imgtransfer/garments": ("simulate", "dress"),
    "imgtransfer/importers/together.py": MESHES,
    "render/files/sequence.py": (),  # what Python calls its own choice of a mesh; commands give theirs
}
PROGRAMS = ("imgtransfer/demo", "imgtransfer/cli")  # that have their own arguments, or speak of nothing else
SECTIONS = {"garment": TemplateConfig, "body": SmplConfig, "files": FileMotions}


def options() -> Iterator[tuple[str, str]]:
    """Module and name of each option that a message names."""
    for layer in ("render", "fusion", "imgtransfer"):
        for file in sorted((ROOT / layer).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                named = (
                    isinstance(node, ast.Call)
                    and isinstance(node.func, ast.Name)
                    and node.func.id == "Option"
                )
                if named and isinstance(node.args[0], ast.Constant):
                    yield str(file.relative_to(ROOT)), node.args[0].value


def commands() -> dict[str, argparse.ArgumentParser]:
    action = build_parser()._subparsers._group_actions[0]
    return action.choices


def flags(parser: argparse.ArgumentParser) -> set[str]:
    return {flag for action in parser._actions for flag in action.option_strings}


def exists(text: str, known: set[str]) -> bool:
    """Whether what a message calls an option is a flag, or a key of the garment's or body's configuration."""
    if setting := re.fullmatch(r"`(\w+)\.(\w+)`", text):
        return setting[2] in SECTIONS[setting[1]].model_fields
    text = text.removesuffix(" gender=...")  # of `--body`
    if change := re.fullmatch(r"--set (\w+)\.(\w+)(=.*)?", text):
        return "--set" in known and change[2] in SECTIONS[change[1]].model_fields
    return text in known


NAMINGS: dict[str, list[Naming]] = {
    "simulate": [as_option, as_option_with_template],
    "dress": [dress.as_option],
}


@pytest.mark.parametrize(("module", "name"), sorted(set(options())))
def test_every_option_of_a_message_is_one_of_its_command(module: str, name: str) -> None:
    if module.startswith(PROGRAMS):
        return
    parts = Path(module).parts
    prefixes = ["/".join(parts[:count]) for count in range(len(parts), 0, -1)]
    own = next((COMMANDS[prefix] for prefix in prefixes if prefix in COMMANDS), None)
    assert own is not None, f"{module} names options: which commands run it?"
    for command in own:
        known = flags(commands()[command])
        for naming in NAMINGS.get(command, [as_flag]):
            assert exists(naming(Option(name)), known), f"imgtransfer {command} has no {naming(Option(name))}"


def test_the_walk_finds_what_is_wrong() -> None:
    assert ("imgtransfer/importers/checks/motion.py", "motion_up") in set(options())
    assert len(set(options())) > 40
    assert not exists("--smpl", flags(commands()["simulate"]))
    assert not exists("`garment.nothing`", set())
    assert exists("`body.path`", set())
    assert exists("--set files.up_axis=z", {"--set"})
    assert not exists("--set files.up_axis=z", {"--up"})
    assert not exists("--set files.nothing", {"--set"})
    assert as_option(Option("smpl")) == as_option_with_template(Option("smpl")) == "`body.path`"
    assert as_option(Option("garment_unit", "cm")) == "`garment.unit: cm`"
    assert as_option_with_template(Option("garment_unit", "cm")) == "--garment-unit=cm"
    assert as_option(Option("motion_up", "z")) == "--motion-up=z"


@pytest.mark.parametrize("command", MESHES)
def test_flags_of_the_commands_own_messages_exist(command: str) -> None:
    """Flags that stand in the text of a command's modules belong to that command."""
    file = {"import": "import_", "fuse": "fuse"}.get(command, command)
    text = (ROOT / f"imgtransfer/cli/{file}.py").read_text(encoding="utf-8")
    parser = commands()[command]
    named = {flag for flag in re.findall(r"(?<![\w-])--[a-z]+(?:-[a-z]+)*(?![\w-])", text)}
    foreign = {"--truth", "--help"}  # `evaluate`'s, in the line that says what may come next
    assert named - flags(parser) - foreign == set()
