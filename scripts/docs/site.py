"""What the site has beside the pages in docs: references made from the parser, the schemas and the packages' surfaces.

Hooks of MkDocs (mkdocs.yml); nothing that is made here is committed.
"""

from __future__ import annotations

import argparse
import ast
import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

LAYERS = {
    "render": "Geometry as images: meshes, files, cameras, rasterisers, maps.",
    "fusion": "Maps back to vertices.",
    "imgtransfer": "Data, bodies, garments, simulation, networks, methods, commands: by package.",
}


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of the reference."""
    from mkdocs.structure.files import File  # noqa: PLC0415

    pages = {
        "reference/commands.md": commands(),
        "reference/configurations.md": configurations(),
        **{f"reference/{layer}.md": surface(layer, about) for layer, about in LAYERS.items()},
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links that lead out of docs become the paths of what they lead to: the site does not hold it."""
    folder = posixpath.dirname(page.file.src_uri)
    return re.sub(r"\[([^\]\n]+)\]\((\.\./[^)\s]+)\)", lambda link: _named(link, folder), markdown)


def _named(link: re.Match[str], folder: str) -> str:
    """A link of a page in `folder` of docs, as it is or as a path from the project's root."""
    text, target = link[1], posixpath.normpath(posixpath.join(folder, link[2]))
    outside, _, path = target.partition("../")
    if outside:
        return link[0]
    return text if path in text else f"{text} (`{path}`)"


def commands() -> str:
    """Every command with its arguments and examples, from the parser itself."""
    from imgtransfer.cli.main import build_parser  # noqa: PLC0415

    parser = build_parser()
    chosen = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    lines = ["# Commands", "", "As `imgtransfer COMMAND --help` prints them.", ""]
    for name, command in chosen.choices.items():
        lines += [f"## {name}", "", command.description or "", "", *_arguments(command)]
        lines += ["```bash", *command.examples, "```", ""]
    return "\n".join(lines)


def _arguments(command: argparse.ArgumentParser) -> Iterator[str]:
    yield from ("| argument | |", "| --- | --- |")
    for action in command._actions:
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._HelpAction):
            continue
        names = ", ".join(action.option_strings) or str(action.metavar or action.dest)
        choices = f" ({', '.join(map(str, action.choices))})" if action.choices else ""
        values = {"prog": command.prog, "default": action.default, "dest": action.dest}
        text = " ".join((action.help or "").replace("|", "\\|").split()) % values
        yield f"| `{names}`{choices} | {text}{'; required' if action.required and action.option_strings else ''} |"
    yield ""


def configurations() -> str:
    """Every key of every configuration, as `imgtransfer config` prints it."""
    from imgtransfer.cli.config import COMMANDS, schema_of  # noqa: PLC0415
    from imgtransfer.config.commented import commented_yaml  # noqa: PLC0415

    lines = ["# Configurations", "", "As `imgtransfer config COMMAND` prints them.", ""]
    for name in COMMANDS:
        lines += [f"## {name}", "", "```yaml", commented_yaml(schema_of(name)).rstrip(), "```", ""]
    return "\n".join(lines)


def surface(layer: str, about: str) -> str:
    """The public names of a layer's packages, from the stubs beside them, each documented where it is defined."""
    lines = [f"# {layer}", "", about, ""]
    for stub in sorted((ROOT / layer).rglob("__init__.pyi")):
        package = ".".join(stub.parent.relative_to(ROOT).parts)
        said = ast.get_docstring(ast.parse(stub.with_suffix(".py").read_text())) or ""
        lines += [f"## {package}", "", said, ""]
        lines += [f"::: {name}\n    options: {{heading_level: 3}}\n" for name in _names(stub, package)]
    return "\n".join(lines)


def _names(stub: Path, package: str) -> Iterator[str]:
    """Where each name of a stub is defined."""
    for node in ast.parse(stub.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            module = ".".join([*parents, *([node.module] if node.module else [])])
            yield from (f"{module}.{alias.name}" for alias in node.names)
