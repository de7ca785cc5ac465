"""Files, packages and names of the project that the pages speak of are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.helpers.paths import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "configs").rglob("*.md")])
PAGES = [page for page in PAGES if page.name != "CHANGELOG.md"]  # which speaks of what was
LAYERS = ("render", "fusion", "imgtransfer")
FOLDERS = ("configs", "docs", "scripts", "tests", *LAYERS)
_CODE = re.compile(r"`([^`\n]+)`")


def prose(page: Path) -> str:
    """A page without its fences, which are commands, programs and examples of output."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def paths(page: Path) -> list[str]:
    """What stands as code and is a path from the project's root."""
    words = [word.rstrip("/.,:") for code in _CODE.findall(prose(page)) for word in code.split()]
    return [
        word
        for word in words
        if "/" in word and word.split("/")[0] in FOLDERS and re.fullmatch(r"[\w./*-]+", word)
    ]


def names(page: Path) -> list[str]:
    """What stands as code and is a dotted name of a layer, not a file such as fusion.json."""
    name = re.compile(rf"^(?:{'|'.join(LAYERS)})(?:\.\w+)+")
    told = [match[0] for code in _CODE.findall(prose(page)) if (match := name.match(code))]
    return [one for one in told if not one.endswith((".md", ".json"))]


def links(page: Path) -> list[str]:
    targets = re.findall(r"\]\(([^)\s#]+)(?:#[^)\s]*)?\)", prose(page))
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def defined(name: str) -> bool:
    """Whether a dotted name is a package or a module, or is named in the one that it begins with."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:count])
        sources = [place.with_suffix(".py"), place / "__init__.pyi", place / "__init__.py"]
        texts = [source.read_text(encoding="utf-8") for source in sources if source.exists()]
        if texts:
            return count == len(parts) or any(re.search(rf"\b{parts[count]}\b", text) for text in texts)
    return place.is_dir()


def rooms() -> list[tuple[str, str]]:
    """Of the tables of architecture.md: each package or module that a row begins with, and those in its brackets."""
    layer, listed = "", []
    for line in (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").split("\n"):
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) != 2 or cells[0].startswith("---"):
            continue
        first = [word.strip("/") for word in _CODE.findall(cells[0])]
        if first in [[one] for one in LAYERS]:
            layer = first[0]
        elif first and layer:
            listed += [(layer, room) for room in first]
            inner = [code for text in re.findall(r"\(([^()]*)\)", cells[1]) for code in _CODE.findall(text)]
            listed += [(f"{layer}.{first[0]}", one) for one in inner if re.fullmatch(r"[a-z_]+(\.\w+)?", one)]
        elif not first:
            layer = layer if cells[0] == "beside them" else ""
    return listed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_speaks_of_is_there(page: Path) -> None:
    assert [
        path for path in paths(page) if not (list(ROOT.glob(path)) or (ROOT / f"{path}.py").exists())
    ] == []
    assert [name for name in names(page) if not defined(name)] == []
    assert [target for target in links(page) if not (page.parent / target).exists()] == []


def test_the_pages_speak_of_many_files_and_names() -> None:
    """So that the test above has something to look at."""
    assert sum(len(paths(page)) for page in PAGES) > 50
    assert sum(len(names(page)) for page in PAGES) > 20


def test_the_packages_of_the_architecture_are_there() -> None:
    listed = rooms()
    assert len(listed) > 60
    assert [f"{parent}.{room}" for parent, room in listed if not defined(f"{parent}.{room}")] == []


def test_packages_are_all_in_the_architecture() -> None:
    """The first level of every layer."""
    listed = {room.split(".")[0] for parent, room in rooms() if parent in LAYERS}
    folders = {path.parent.name for layer in LAYERS for path in (ROOT / layer).glob("*/__init__.py")}
    assert folders - listed == set()


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("render", True),
        ("render.maps.imager", True),
        ("render.maps.imager.TemplateImager", True),
        ("render.TemplateImager", True),
        ("render.maps.nowhere", False),
        ("render.TemplateImagery", False),
    ],
)
def test_a_name_is_told_from_none(name: str, there: bool) -> None:
    assert defined(name) == there
